r"""A shock: something is knocked, dropped or driven over, and rings for a moment.

For a second or ten the samples move by many times their noise, to and fro, and then it is over;
perhaps the level is another one afterwards, which is a `step` of its own. In the spectrum a shock
is everywhere, in the curve it looks like white noise or a random walk, and one that is explained by
steps and excursions takes a dozen of them. So it is found in time, before everything else, and on
all axes together (`shock_rows`): what shakes one axis is looked for on the others at that moment,
with one time and duration. These rows are taken out: the level before is drawn through them to the
level after, with noise like that beside them on it, so that the spectrum has no gap there. What
changes the level within the time of a shock is one `step` at most, and belongs to its finding.
A pulse to one side that is over within two seconds (a self test, an elevator that sets off) is one
too: it rings less, and its rows tell as little of the noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.noise_level_border import instant_of
from allanscope.explain.shock_removal import (
    LONGEST_PULSE_S,
    MARGIN_S,
    extent_of,
    quiet_rows,
    shaken_rows,
    with_pulse,
)
from allanscope.explain.shock_rows import ShockRows
from allanscope.explain.view import View
from allanscope.noise.grid import Grid
from allanscope.quantities import MAD_TO_SIGMA

Array = NDArray[np.float64]

_SWITCHED, _HALF = 5.0, 0.5
"""Standard errors of the power on one side over that on the other from which something lasts, and
the share of the power that must be over when what shook the board is."""
_OFF_ROWS = 12
"""Rows by which the time of a shock may be off: a mean of so many begins to be loud."""
_FAR = 6.0
"""Standard errors within which the largest row of a shock is."""
_BESIDE_S = 5.0
"""Time beside a shock that tells the noise."""
_LINED = 1.5
"""Scatter of what lies beside a shock, in sigma, from which lines are a part of it."""


@dataclass(frozen=True)
class Shock(EffectKind):
    """One shock."""

    time: Estimate
    duration: Estimate
    peak: Estimate
    end: str | None = None
    """``first`` or ``last`` where it is an end of the record that is off the level."""

    kind = "shock"
    meaning = "a mechanical shock that rings, or a pulse of a second"
    phrase = "shock at {event}, up to {peak}"
    motion = "burst"
    acts_fast = False
    # Not `sized_by`: near the limit its peak, a mean over all that may ring, is no larger.
    stage = 0
    located_by = "time"
    shared_by = "time"
    is_rival = False
    is_not_gaussian = False
    removes_rows = True
    is_motion: ClassVar[bool] = False
    """Whether the board is moved, for longer than a shock."""
    confused_with: ClassVar[Mapping[str, str]] = {
        "outliers": "last one sample each",
        "excursion": "stays at another level",
        "variance_change": "is a few times stronger than the rest, not ten times",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        if self.end:
            return (
                f"the {self.end} {self.duration.value:.2g} s are off the level by up to "
                f"{self.peak.text}, removed"
            )
        return (
            f"a shock of up to {self.peak.text} at {self.time.value:.1f} s "
            f"for {self.duration.value:.2g} s, removed"
        )

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether another shock is the same."""
        del grid
        return abs(self.time.value - other.time.value) < self.duration.value + MARGIN_S

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Take the shocks that the record holds on whichever axis, where this axis is moved."""
        known = [_extent(c.effect, view) for c in view.accepted if isinstance(c.effect, Shock)]
        found = [
            cls.of_rows(view, shaken)
            for shaken in _shaken(view)
            if view.axis in shaken.axes
            and shaken.is_motion == cls.is_motion
            and not any(first < shaken.stop and shaken.first < stop for first, stop in known)
        ]
        return [one for one in found if one is not None]

    @classmethod
    def of_rows(
        cls, view: View, shaken: ShockRows, peak: Estimate | None = None
    ) -> Candidate | None:
        """Return a shock without its rows; None where it is none. Its peak is that of its rows."""
        rate, n = view.grid.rate_hz, len(view.data)
        sigma = shaken.sigma[view.axis]
        shaken = with_pulse(view.data, shaken, rate)
        if not cls.is_motion and _goes_on(view.data, shaken.first, shaken.stop, sigma):
            return None
        first, stop = extent_of(view.data, shaken, rate)
        others = shaken_rows(view.series.shocks, shaken, n, rate)
        rest, level = quiet_rows(view.data, first, stop, sigma, others)
        signal = np.zeros(n)
        signal[first:stop] = view.data[first:stop] - rest
        duration = (shaken.stop - shaken.onset[0]) / rate
        ring = shaken.rings.get(view.axis)
        if ring is None:
            size = np.abs(view.data[first:stop] - level)
            if np.std(rest - level) > _LINED * sigma:  # a line goes on through it
                size = np.abs(signal[first:stop])
            gain = 0.5 * float(np.sum(np.maximum((size / sigma) ** 2 - 1, 0.0)))
            off = max(_OFF_ROWS, shaken.onset[0] - shaken.onset[1] if cls.is_motion else 0) / rate
            lasts = Estimate(duration, max(duration - 2 * off, 0.0), duration + off, "s")
            peak = peak or _peak(size, sigma, view.unit)
        else:  # of decay times in a ratio of two
            gain, lasts = ring.gain, Estimate(duration, duration / 2, duration * 2, "s")
            peak = Estimate.of(ring.peak[0] * sigma, ring.peak[1] * sigma, view.unit)
        end = ("first" if shaken.first == 0 else "last") if shaken.is_off else None
        effect = cls(instant_of(shaken.onset, rate, view.series.start_s), lasts, peak, end)
        return Candidate(effect, gain, shaken.log_alternatives, signal=signal)

    @classmethod
    def instead_of(cls, view: View, candidate: Candidate) -> Candidate | None:
        """Return a shock of other axes that a change of level or noise is, if it is over with it.

        What is too soft here to be found by its rows looks like steps, an excursion or a burst.
        """
        rate = view.grid.rate_hz
        margin, longest = MARGIN_S * rate, LONGEST_PULSE_S * rate
        times = _ends(candidate.effect) or _stretch(candidate.effect)
        rows = [view.row_at(time) for time in times]
        for shaken in view.series.shocks if rows else ():
            last = max(shaken.stop + margin, shaken.first + longest)
            within = shaken.first - margin <= rows[0] and rows[-1] <= last
            is_other = view.axis not in shaken.axes and shaken.is_motion == cls.is_motion
            if is_other and within and not shaken.is_off:
                stop = max(shaken.stop, int(np.ceil(rows[-1])))
                return cls._softly(view, replace(shaken, stop=stop, rings={}), candidate)
        return None

    @classmethod
    def _softly(cls, view: View, shaken: ShockRows, candidate: Candidate) -> Candidate | None:
        """Return the shock in the place of a change; None where that is left without its rows.

        Its gain, and the peak of what has a size, are those of the change: its rows are too soft.
        """
        beside = int(_BESIDE_S * view.grid.rate_hz)
        first, stop = shaken.first, shaken.stop
        sides = view.data[max(0, first - beside) : first], view.data[stop : stop + beside]
        rest = np.concatenate([rows - np.median(rows) for rows in sides if len(rows)])
        sigma = max(MAD_TO_SIGMA * float(np.median(np.abs(rest))), 0.5 * view.step)
        size = candidate.effect.parameters.get("size")
        peak = (
            Estimate.of(abs(size.value), size.error, view.unit)
            if isinstance(size, Estimate)
            else None
        )
        found = cls.of_rows(view, replace(shaken, sigma={view.axis: sigma}), peak)
        held = candidate.effect.hold_out(view, candidate)
        if found is None or (held is not None and held.nats <= held.error):
            return None
        left = candidate.effect.refine(view.accept(found))
        if left is not None and left.excess > 0:
            return None
        return replace(found, gain=candidate.gain, log_alternatives=candidate.log_alternatives)

    def refuses(self, view: View, known: Candidate, other: Candidate) -> str:
        """Refuse changes of the level within it: what is left of a shock is one step at most."""
        del known
        times = _ends(other.effect)
        first, stop = _extent(self, view)
        margin = MARGIN_S * view.grid.rate_hz

        def is_inside(time: float) -> bool:
            return first - margin <= view.row_at(time) <= stop + margin

        is_within = bool(times) and all(map(is_inside, times))
        has_one = any(is_inside(t) for c in view.accepted for t in _ends(c.effect))
        return "part of a shock" if is_within and (len(times) > 1 or has_one) else ""


def _shaken(view: View) -> Iterable[ShockRows]:
    """Return the shocks of the record; where a coupling is known, those in what it leaves."""
    coupled = (c for c in view.accepted if "source" in c.effect.parameters)
    if all(c.signal is None for c in coupled):
        return view.series.shocks
    return view.series.shocks_in(**{view.axis: view.data})


def _ends(effect: EffectKind) -> list[float]:
    """Return when an effect changes the level, in s; never for most kinds."""
    at, length = effect.parameters.get("time"), effect.parameters.get("duration")
    if not effect.is_piecewise or at is None:
        return []
    times = [float(at.value)]
    return times if length is None else [*times, times[0] + float(length.value)]


def _stretch(effect: EffectKind) -> list[float]:
    """Return when the noise begins and ends to be louder, in s."""
    ends = (effect.parameters.get(name) for name in ("start", "stop"))
    return [float(one.value) for one in ends if one is not None]


def _extent(effect: Shock, view: View) -> tuple[int, int]:
    """Return the first row of a shock and the one after its last."""
    first = view.row_at(effect.time.value)
    return round(first), round(first + effect.duration.value * view.grid.rate_hz)


def _goes_on(data: Array, first: int, stop: int, sigma: float) -> bool:
    """Return whether what begins or ends with some rows is as loud on one side of them.

    A pump that is switched on begins with a bang for all that its spectrum has whitened.
    """
    size = stop - first
    sides = data[max(0, first - size) : first], data[stop : stop + size]
    if min(map(len, sides)) < size:
        return False
    inside = float(np.sum((data[first:stop] - np.median(data[first:stop])) ** 2))
    one, other = sorted(float(np.sum((side - np.median(side)) ** 2)) for side in sides)
    lasts = other - one > _SWITCHED * 2.0 * sigma**2 * np.sqrt(size)
    return bool(lasts and inside - other < _HALF * (inside - one))


def _peak(size: Array, sigma: float, unit: str) -> Estimate:
    """Return the largest of some sizes to each of which noise was added.

    The largest sum is larger than the largest size, the more so the more of them are near it. By
    how much is taken from what more such noise would do to the sums (Efron's bootstrap); the
    distribution of their largest is the product of those of each. With that taken off it scatters
    as one of them, however many are near: what their largest scatters less is in what is taken off.
    """
    largest = float(size.max())
    near = size[size > largest - _FAR * sigma]
    at = largest + sigma * np.linspace(-_FAR, _FAR, 801)
    below = np.prod(ndtr((at - near[:, np.newaxis]) / sigma), axis=0)
    mean = at[-1] - float(np.trapezoid(below, at))
    return Estimate.of(2 * largest - mean, sigma, unit)
