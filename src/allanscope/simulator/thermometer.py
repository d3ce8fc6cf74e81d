"""The temperature of the sensor, and what its thermometer says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects.base import Run
from allanscope.simulator.noise.gauss_markov import GaussMarkov
from allanscope.simulator.truth import TemperatureTruth

__all__ = ["Thermometer"]

REFRESH_HZ = 52.0
"""The part renews its temperature register at this rate and holds it in between."""


class Thermometer:
    """T(t) = start + room(t) + rise (1 - exp(-t / time constant)), read with white noise.

    Parameters
    ----------
    truth : TemperatureTruth
        Constants of the equation.
    run : Run
        What is the same for all axes.
    """

    def __init__(self, truth: TemperatureTruth, run: Run) -> None:
        self._truth = truth
        self._hold = max(1, round(run.rate_hz / REFRESH_HZ))
        self._refresh_hz = run.rate_hz / self._hold
        self._room = GaussMarkov(
            truth.wander_c, truth.wander_s, self._refresh_hz, run.stream("room")
        )
        self._noise = run.stream("thermometer")
        self._row = 0
        self._refreshed = 0
        self._room_at_start = float(self._room.take(1)[0])
        self._last = np.empty((2, 0))

    def take(self, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return true temperature and reading in degC at the next `n` samples, each (n,)."""
        refresh = np.arange(self._row, self._row + n) // self._hold
        begin = self._refreshed - self._last.shape[1]
        known = np.hstack((self._last, self._renew(int(refresh[-1]) + 1 - self._refreshed)))
        self._last = known[:, -1:]
        self._row += n
        true, reading = known[:, refresh - begin]
        return true, reading

    def _renew(self, n: int) -> NDArray[np.float64]:
        """Return the next `n` values of the register: true temperature and reading, (2, n)."""
        truth = self._truth
        time_s = np.arange(self._refreshed, self._refreshed + n) / self._refresh_hz
        self._refreshed += n
        room = self._room.take(n) - self._room_at_start
        rise = -truth.self_heating_c * np.expm1(-time_s / truth.self_heating_s)
        true = truth.start_c + room + rise
        return np.vstack((true, true + truth.sensor_noise_c * self._noise.standard_normal(n)))
