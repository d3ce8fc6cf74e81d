"""Device time and temperature of data frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Ticks
from allanscope.wire.native.descriptor import Descriptor
from allanscope.wire.native.layout import NO_TEMPERATURE, NO_TICKS, Clock
from allanscope.wire.native.run import Run

__all__ = ["Ticking"]

_RANGE = 1 << 32


class Ticking:
    """Times of the frames of one epoch, one tick a frame."""

    def __init__(self) -> None:
        self._last: tuple[int, int] | None = None

    def ticks(self, run: Run, known: Descriptor) -> Ticks:
        """Return the ticks of a run."""
        headers = run.headers
        crystal = known.clock is not Clock.NONE
        return Ticks(
            offset=np.cumsum(headers["n"], dtype=np.int64) - headers["n"],
            device_s=headers["mcu_us"] / 1e6 if crystal else self._sensor_time(run, known),
            host_s=run.host_s,
            temperature_c=_temperature_c(headers["temperature"], known),
        )

    def _sensor_time(self, run: Run, known: Descriptor) -> NDArray[np.float64]:
        """Return the sensor's own time, unwrapped, for a device that has no clock."""
        stamps = run.headers["sensor_ticks"].astype(np.int64)
        seconds = np.full(len(stamps), np.nan)
        present = stamps != NO_TICKS
        if present.any():
            seen = stamps[present]
            raw, total = self._last or (int(seen[0]), int(seen[0]))
            # A difference modulo 2^32 is right as long as two frames are nearer than that.
            totals = total + np.cumsum(np.diff(seen, prepend=raw) % _RANGE)
            self._last = int(seen[-1]), int(totals[-1])
            seconds[present] = totals * (known.tick_ns * 1e-9)
        return seconds


def _temperature_c(counts: NDArray[np.int16], known: Descriptor) -> NDArray[np.float64]:
    """Return temperatures in degC; NaN where none was sent, or the device does not scale them."""
    if known.temperature_lsb_per_c is None:
        return np.full(len(counts), np.nan)
    degrees = counts / known.temperature_lsb_per_c + known.temperature_zero_c
    return np.where(counts == NO_TEMPERATURE, np.nan, degrees)
