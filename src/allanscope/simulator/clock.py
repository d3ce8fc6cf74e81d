"""The two clocks of a device, both slightly wrong: the sensor's oscillator, the MCU's crystal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from allanscope.simulator.random_streams import stream

__all__ = ["DeviceClock"]

LARGEST_ERROR = 0.045
"""ST's own logs show -4.4 % and +1.9 % for parts of this family."""
CRYSTAL_PPM = 20.0
LATENCY_S = 10e-6
"""A time stamp is taken up to this long after the sample was ready."""


@dataclass(frozen=True, slots=True)
class DeviceClock:
    """How true time, samples and time stamps hang together.

    Attributes
    ----------
    nominal_hz : float
        Sample rate that the device claims.
    relative_error : float
        True sample rate / nominal rate - 1.
    crystal_ppm : float
        Error of the crystal that makes the time stamps.
    """

    nominal_hz: float
    relative_error: float
    crystal_ppm: float

    @classmethod
    def of_specimen(cls, nominal_hz: float, seed: int, relative_error: float | None) -> DeviceClock:
        """Return the clocks of one specimen; without an error it has one of up to +-4.5 %."""
        rng = stream(seed, "clock")
        drawn, ppm = rng.uniform(-LARGEST_ERROR, LARGEST_ERROR), rng.normal(0.0, CRYSTAL_PPM)
        return cls(nominal_hz, drawn if relative_error is None else relative_error, ppm)

    @property
    def true_hz(self) -> float:
        """True sample rate."""
        return self.nominal_hz * (1.0 + self.relative_error)

    def stamps(self, time_s: NDArray[np.float64], rng: Generator) -> NDArray[np.float64]:
        """Return what the MCU's clock shows for samples ready at true times `time_s`."""
        late = rng.uniform(0.0, LATENCY_S, len(time_s))
        return np.asarray((time_s + late) * (1.0 + 1e-6 * self.crystal_ppm))
