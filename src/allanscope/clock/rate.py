"""The clock of a run: which rate is the true one, and how well it is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from allanscope.clock.envelope import Envelope
from allanscope.clock.line import LineFit
from allanscope.samples import Gap, StreamInfo, Ticks

__all__ = ["Clock", "ClockError", "RateFit"]

USB_FRAME_S = 1e-3
"""A host asks a full-speed USB device once in a millisecond; arrivals have that step."""

ROUNDING_S = 1e-7
"""No device time is trusted more finely than this."""

KNOWN_BELOW = 0.01
"""A rate whose relative standard deviation is larger than this is not worth replacing the nominal
one: these parts are off by several per cent at most."""

CRYSTAL = 40e-6
"""Standard deviation of a crystal's rate: 50 ppm of tolerance, temperature and ageing."""

CONTRADICTION = 4.0
"""Standard deviations that two clocks may be apart."""


DISAGREEMENT = 1e-3
"""Crystals are off by less than a tenth of this. A host that sees the device's crystal off by more
has read late: what had waited while it was held up came in a rush, and looks like a high rate."""


@dataclass(frozen=True, slots=True)
class ClockError:
    """True rate over nominal rate, minus one, with its 95 % interval."""

    relative: float
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class RateFit:
    """The sample rate.

    Attributes
    ----------
    nominal_hz : float
        What the device claims; 0 when it claims nothing.
    hz : float
        The best rate that is known.
    source : {'host', 'device', 'nominal'}
        The clock that it was measured with; ``nominal`` as long as it has not been measured.
    uncertainty_ppm : float
        Standard deviation of `hz` relative to that clock; infinite when it was not measured. The
        error of the clock itself comes on top: some 20 to 50 ppm for a computer that is not
        disciplined by NTP, and for the crystal of a device. Where a device's crystal stands in for
        the computer's clock, in the first seconds of a run, its own error is part of it.
    residual_s : float
        Standard deviation of the times about the line.
    span_s : float
        Time over which it was measured.
    drift_ppm_per_h, drift_uncertainty_ppm_per_h : float
        Change of the rate, warm-up of the sensor's oscillator for instance; NaN when not known.
    ppm_per_degc, ppm_per_degc_uncertainty : float
        Change of the rate with the temperature, as far as one follows the other; NaN when not
        known.
    steps : int
        Times at which the delay changed for good: samples lost without a word, a computer that
        slept, a clock that was set.
    host, device : LineFit or None
        Both fits, to compare: how many samples pass in a second of the host, and in a second of
        the device's crystal.
    """

    nominal_hz: float
    hz: float
    source: Literal["host", "device", "nominal"]
    uncertainty_ppm: float = math.inf
    residual_s: float = math.nan
    span_s: float = 0.0
    drift_ppm_per_h: float = math.nan
    drift_uncertainty_ppm_per_h: float = math.nan
    ppm_per_degc: float = math.nan
    ppm_per_degc_uncertainty: float = math.nan
    steps: int = 0
    host: LineFit | None = None
    device: LineFit | None = None

    @property
    def is_measured(self) -> bool:
        """Whether `hz` is more than what the device claims."""
        return self.source != "nominal"

    @property
    def clock_error(self) -> ClockError | None:
        """By how much the sensor's oscillator is off; None until it has been measured."""
        if not self.is_measured or not self.nominal_hz > 0.0:
            return None
        relative = self.hz / self.nominal_hz - 1.0
        half = 1.96 * self.uncertainty_ppm * 1e-6 * self.hz / self.nominal_hz
        return ClockError(relative, relative - half, relative + half)

    @property
    def device_against_host(self) -> float | None:
        """Relative error of the device's crystal as the host sees it; None without both clocks.

        A crystal is off by some ten ppm. Much more says that the device's time is no time, or that
        samples are lost without a trace.
        """
        if self.host is None or self.device is None:
            return None
        return self.host.hz / self.device.hz - 1.0


class Clock:
    """Follow a stream and know its true sample rate, in memory that does not grow.

    Parameters
    ----------
    nominal_hz : float
        Rate that the device claims; 0 when it claims none.
    device_clock : bool
        Whether the device's time is a clock of its own, a crystal. The time of the sensor's own
        oscillator is not: it is off by as much as the rate is.
    device_resolution_s : float
        Step of the device's time.
    crystal : bool
        Whether the device's clock is known to be a crystal, which is believed against the host.

    Examples
    --------
    Records of a file, 51 in a second, with no other time than the device's:

    >>> import numpy as np
    >>> clock = Clock(nominal_hz=50.0)
    >>> offset, unknown = np.arange(1000), np.full(1000, np.nan)
    >>> clock.update(0, Ticks(offset, offset / 51.0, unknown, unknown))
    >>> rate = clock.rate()
    >>> print(f"{rate.hz:.3f} Hz by the {rate.source}, {rate.clock_error.relative:+.1%}")
    51.000 Hz by the device, +2.0%
    """

    def __init__(
        self,
        nominal_hz: float = 0.0,
        device_clock: bool = True,
        device_resolution_s: float = 0.0,
        crystal: bool = False,
    ) -> None:
        self.nominal_hz = nominal_hz
        self._device_clock = device_clock
        self._crystal = crystal
        self._device_resolution_s = device_resolution_s
        self.restart()

    @classmethod
    def of(cls, info: StreamInfo) -> Clock:
        """Return the clock of a stream that describes itself."""
        # The times of a table may be anybody's; a device that frames its samples has a clock.
        crystal = info.device_clock and info.wire not in ("text", "arrays")
        return cls(info.nominal_hz, info.device_clock, info.time_resolution_s, crystal)

    def update(self, index: int, ticks: Ticks) -> None:
        """Take the ticks of a block whose first sample has the number `index`."""
        number = index + ticks.offset
        self._host.add(number, ticks.host_s, ticks.temperature_c)
        if self._device_clock:
            self._device.add(number, ticks.device_s, ticks.temperature_c)

    def gap(self, gap: Gap) -> None:
        """Take a hole; only one that leaves the numbers without meaning breaks the lines."""
        if gap.lost is None or gap.reason in ("restarted", "resumed", "file"):
            self._host.cut()
            self._device.cut()

    def restart(self, nominal_hz: float | None = None) -> None:
        """Forget everything, because the device has been told to run at another rate."""
        if nominal_hz is not None:
            self.nominal_hz = nominal_hz
        self._host = Envelope(USB_FRAME_S, self.nominal_hz, polled=True)
        self._device = Envelope(max(self._device_resolution_s, ROUNDING_S), self.nominal_hz)

    def rate(self) -> RateFit:
        """Return the best rate that is known now: by the host, by the device, or the nominal one.

        The host's clock is the truth. But its arrivals come unevenly, and in the first seconds the
        crystal of the device knows better: then its rate is given, with all that a crystal may be
        off. Where the two contradict each other by more than crystals can, a device that says that
        its clock is a crystal is believed: the host has read late. Otherwise its time is none.
        """
        host, device = self._host.fit(), self._device.fit()
        host_sigma = host.relative_sigma if host is not None else math.inf
        device_sigma = device.relative_sigma if device is not None else math.inf
        if host is not None and device is not None:
            if self._crystal and device_sigma < KNOWN_BELOW and _apart(host, device):
                return self._fit(device, "device", device_sigma, host, device)
            device_sigma = math.hypot(device_sigma, CRYSTAL)
            apart = abs(host.hz / device.hz - 1.0)
            if apart > CONTRADICTION * math.hypot(host_sigma, device_sigma):
                device_sigma = math.inf
        if device is not None and device_sigma < min(host_sigma, KNOWN_BELOW):
            return self._fit(device, "device", device_sigma, host, device)
        if host is not None and host_sigma < KNOWN_BELOW:
            return self._fit(host, "host", host_sigma, host, device)
        return RateFit(self.nominal_hz, self.nominal_hz, "nominal", host=host, device=device)

    def _fit(
        self,
        fit: LineFit,
        source: Literal["host", "device"],
        relative_sigma: float,
        host: LineFit | None,
        device: LineFit | None,
    ) -> RateFit:
        return RateFit(
            self.nominal_hz,
            fit.hz,
            source,
            relative_sigma * 1e6,
            fit.residual_s,
            fit.span_s,
            fit.drift_per_h * 1e6,
            fit.drift_sigma_per_h * 1e6,
            fit.per_degc * 1e6,
            fit.per_degc_sigma * 1e6,
            fit.steps,
            host,
            device,
        )


def _apart(host: LineFit, device: LineFit) -> bool:
    """Return whether two clocks disagree by more than crystals do, and more than by chance."""
    sigma = math.hypot(host.relative_sigma, device.relative_sigma)
    return abs(host.hz / device.hz - 1.0) > DISAGREEMENT + 3.0 * sigma
