r"""When in the record the power of a range of frequencies is there.

A compressor that runs for two minutes and people who walk by are as plain in time as in frequency.
The ordinates of the range, and of as much beside it as the parts of time are short, are taken back
into time; the power of each part stands against what the noise has there,

.. math:: e_p = \sum_{t \in p} x_t^2 - n_p \bar\lambda, \qquad
          \mathrm{sd}(e_p) = n_p \bar\lambda \sqrt{2 / d_p}

with the :math:`d_p = 2 w n_p \Delta t` degrees of freedom of a part in a band of width w. The
finest parts in which those that stand out hold most of the power tell when it is there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.series import in_time
from allanscope.explain.view import Span, View

__all__ = ["FINEST", "Presence", "presence_of"]

Array = NDArray[np.float64]

_PARTS = (256, 128, 64, 32, 16)
"""Parts of the record, the finest first."""
FINEST = _PARTS[0]
"""Parts of the record to one of which it is known when something begins and ends."""
_STANDS_OUT = 5.0
"""Standard deviations of the noise in a part: its chi-square has few degrees of freedom, and of 256
parts one comes so far in one record of ten."""
_MOST = 0.9
"""Share of the power that the parts which stand out must hold."""
_PARTLY = 0.5
"""Share of the record up to which power is there in a part of it only: 90 % of what noise in a band
makes, whose power in a part is exponentially distributed, come in 0.59 of the parts where a part is
one coherence time, and in more of them where it is longer."""
_FEWEST_WAVES = 2.0
"""Of the middle of the range in a part: of fewer, the power depends on the phase."""
_TOLD = 3
"""Most stretches that a sentence names."""


@dataclass(frozen=True)
class Presence:
    """Stretches of the record.

    Attributes
    ----------
    share : float
        Of the record.
    spans : tuple of (float, float)
        From and until when, in s, in the order of time.
    """

    share: float
    spans: tuple[Span, ...]

    @property
    def longest_s(self) -> float:
        """Length of the longest stretch."""
        return max(last - first for first, last in self.spans)

    def surroundings(self, times: Array) -> NDArray[np.bool_]:
        """Tell which instants are in a stretch, or as near to one as it is long."""
        near = np.zeros(len(times), bool)
        for first, last in self.spans:
            near |= np.abs(times - (first + last) / 2) < 1.5 * (last - first)
        return near

    @property
    def words(self) -> str:
        """When, in a phrase: the longest stretches, in the order of time."""
        longest = sorted(self.spans, key=lambda span: span[0] - span[1])[:_TOLD]
        told = [f"{first:.4g} s to {last:.4g} s" for first, last in sorted(longest)]
        more = len(self.spans) - len(told)
        if more:
            told.append(f"{more} more")
        when = told[0] if len(told) == 1 else f"{', '.join(told[:-1])} and {told[-1]}"
        return f"in {100 * self.share:.2g} % of the record: {when}"


def presence_of(view: View, low: float, high: float) -> Presence | None:
    """Return when the power between two frequencies in Hz is there; None where it is all along.

    `view` is without what that power is.
    """
    grid = view.grid
    length_s = grid.n / grid.rate_hz
    for parts in _PARTS:
        reach = parts / length_s
        if grid.n < 2 * parts or low + high < 2 * _FEWEST_WAVES * reach:
            continue
        near = grid.around((low + high) / 2, (high - low) / 2 + reach)
        inside = np.abs(grid.frequency[near] - (low + high) / 2) < (high - low) / 2 + reach
        inside &= grid.frequency[near] > min(low, reach)  # what is slower is no part of it
        if not inside.any():
            continue
        own = np.zeros(grid.n - 1)
        own[near] = view.ordinates[near] * inside
        wave = in_time(own)
        edges = np.linspace(0, grid.n, parts + 1).astype(int)
        power = np.add.reduceat(wave**2, edges[:-1])
        noise = float(view.spectrum.ordinates[near][inside].sum()) / parts
        freedom = max(np.count_nonzero(inside) / parts, 1.0)
        excess = power - noise
        loud = excess > _STANDS_OUT * noise * np.sqrt(2 / freedom)
        if not loud.any() or excess[loud].sum() < _MOST * excess.sum():
            continue
        share = float(loud.mean())
        if share > _PARTLY:
            return None
        times = view.time_at(edges.astype(np.float64))
        return Presence(share, _spans(loud, times))
    return None


def _spans(loud: NDArray[np.bool_], times: Array) -> tuple[Span, ...]:
    """Return from when until when parts are loud, across single ones that are not.

    Examples
    --------
    >>> _spans(np.array([0, 1, 0, 1, 0, 0, 1], bool), np.arange(8) / 2)
    ((0.5, 2.0), (3.0, 3.5))
    """
    at = np.flatnonzero(loud)
    groups = np.split(at, np.flatnonzero(np.diff(at) > 2) + 1)
    return tuple((float(times[one[0]]), float(times[one[-1] + 1])) for one in groups)
