"""Has a line begun? One CUSUM for each bin of the spectrum, against its own reference.

The periodogram of a block over its reference is exponentially distributed with mean 1. For two
alternatives, a mean of 1 + rho, the running sum of log-likelihood ratios that is set back to zero
whenever it falls below (Page) is the largest of e-processes begun at every block.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.watch.spending import log_weight

__all__ = ["LineAlarm", "Lines"]

SIZES = (0.7, 5.0)
"""Mean power that a line adds to its bin, in units of the noise there."""

CAP = 12.0
"""Ratio beyond which a block counts no more: a knock is in all bins of one block."""

WARM_UP = 120
"""Blocks that the reference needs before lines are looked for."""


@dataclass(frozen=True, slots=True)
class LineAlarm:
    """A bin whose power is not what it was.

    Attributes
    ----------
    axis, bin : int
        Where.
    since : int
        Blocks for which it has been so: the last of them at which the sum was zero.
    ratio : float
        Mean power in these blocks, in units of the reference.
    nats : float
        The sum.
    """

    axis: int
    bin: int
    since: int
    ratio: float
    nats: float


class Lines:
    """Follow the bins of `axes` spectra."""

    def __init__(self, axes: int, bins: int, log_alpha: float) -> None:
        self.blocks = 0
        self._limit = math.log(bins * len(SIZES)) - log_alpha
        shape = len(SIZES), axes, bins
        self._sums = np.zeros(shape, np.float32)
        self._since = np.zeros(shape, np.int32)
        self._ratios = np.zeros(shape, np.float32)
        self._overdispersion = np.ones((axes, bins), np.float32)

    def take(self, ratio: NDArray[np.float32], held: NDArray[np.bool_]) -> list[LineAlarm]:
        """Take the ratios of a block, shape (axes, bins); return one alarm an axis at most.

        Parameters
        ----------
        ratio : ndarray
            Power over reference.
        held : ndarray of bool, shape (axes, bins)
            Bins that are not looked at: an event is known there.
        """
        self.blocks += 1
        # Exponential ratios have a mean square of 2. Where it is larger, as on a line that was
        # always there and beats with another, ratios count for less.
        gain = np.float32(1.0 / min(self.blocks, 1800))
        square = np.minimum(ratio, CAP) ** 2 / 2
        self._overdispersion += gain * (square - self._overdispersion)
        if self.blocks <= WARM_UP:
            return []
        scaled = np.minimum(ratio, CAP) / np.maximum(self._overdispersion, 1.0)
        alarms: dict[int, LineAlarm] = {}
        limit = self._limit - log_weight(self.blocks)
        for number, rho in enumerate(SIZES):
            sums, since, ratios = self._sums[number], self._since[number], self._ratios[number]
            sums += scaled * np.float32(rho / (1 + rho)) - np.float32(math.log1p(rho))
            over = (sums <= 0.0) | held
            since += 1
            ratios += ratio
            sums[over] = 0.0
            since[over] = 0
            ratios[over] = 0.0
            if float(sums.max()) < limit:
                continue
            for axis in np.flatnonzero(sums.max(axis=1) >= limit):
                at = int(sums[axis].argmax())
                length = int(since[axis, at])
                alarm = LineAlarm(
                    int(axis), at, length, float(ratios[axis, at]) / length, float(sums[axis, at])
                )
                known = alarms.get(alarm.axis)
                if known is None or alarm.nats > known.nats:
                    alarms[alarm.axis] = alarm
        return list(alarms.values())

    def forget(self, axis: int) -> None:
        """Begin all sums of an axis anew."""
        self._sums[:, axis] = 0.0
        self._since[:, axis] = 0
        self._ratios[:, axis] = 0.0
