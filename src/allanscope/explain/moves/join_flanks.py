"""Count what is there only while a loud line is there, near it and far below it, as a part of it.

A machine that is switched on and off begins and ends at once: its line has flanks that reach far
beyond it, and where it is loud they stand out of the noise in ranges of some millihertz. They say
nothing that is not said by the line, and when. They stay out of the fit, as its own range does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects.drifting_line import DriftingLine
from allanscope.explain.effects.unexplained import Unexplained
from allanscope.explain.effects.variance_change import VarianceChange
from allanscope.explain.moves import SearchPath
from allanscope.explain.presence import FINEST
from allanscope.explain.series import in_time
from allanscope.explain.view import Flags, Span, View

__all__ = ["join_flanks"]

Array = NDArray[np.float64]

_FAR = 0.2
"""Distance from a line over its frequency up to which something may be a flank."""
_FLANK = 0.1
"""Power beyond a distance over that of a line, times the distance in bandwidths: four times that
beside a line which is switched, or whose phase wanders."""
_MOST = 0.1
"""Power of a flank over that of the line, at the most."""
_FAINT_GAIN, _MOMENT = 0.01, 0.35
"""Gain of louder noise over that of a line, and its length over that of the stretch in which the
line is there, below which it is where that begins or ends."""
_NOTHING = 1e-4
"""Power below which what has no name is a flank, whenever it is there: it is too faint to tell."""
_OUTSIDE, _FEWEST = 0.5, 0.2
"""Power that may come while the line is not there, over that of what is there all along: so far a
narrow range spreads it; and the share of the record that this is, at the least."""


@dataclass(frozen=True)
class _Power:
    """What is in the ranges of a candidate and in no others.

    Attributes
    ----------
    wave : ndarray, shape (n,)
        In time.
    noise : float
        What the noise has there, as the sum of squares.
    ordinates : int
        How many they are.
    """

    wave: Array
    noise: float
    ordinates: int

    @classmethod
    def of(cls, view: View, candidate: Candidate) -> _Power:
        others = tuple(one for one in view.excluded if one not in candidate.excluded)
        own = view.grid.kept(others) & ~view.grid.kept(candidate.excluded)
        noise = float(view.spectrum.ordinates[own].sum())
        return cls(in_time(view.ordinates * own), noise, int(own.sum()))

    def blurred_s(self, view: View) -> float:
        """Return the time that so narrow a range resolves."""
        return 2 * view.series.duration_s / max(self.ordinates, 1)

    @property
    def variance(self) -> float:
        """Mean square above the noise."""
        return max((float(self.wave @ self.wave) - self.noise) / len(self.wave), 0.0)

    def is_within(self, rows: Flags) -> bool:
        """Return whether little of it is in other rows, of which there must be some."""
        share = 1.0 - float(rows.mean())
        power = self.wave**2
        total = float(power.sum()) - self.noise
        outside = float(power[~rows].sum()) - share * self.noise
        return share > _FEWEST and outside < _OUTSIDE * share * total


def join_flanks(view: View, path: SearchPath) -> View:
    """Return the view with the flanks of lines that are there in a part of the record as theirs."""
    for edge in [c for c in view.accepted if _is_edge(view, c)]:
        path.note("join", edge, "where a line begins or ends")
        view = view.without(edge)
    found = [(c, _Power.of(view, c)) for c in view.accepted if _may_be_flank(c)]
    grown: dict[int, Candidate] = {}
    for first, power in sorted(found, key=lambda pair: pair[1].variance):
        flank = grown.get(id(first), first)  # a line with flanks may be one of a louder line
        line = _line_of(view, flank, power)
        if line is not None:
            path.note("join", flank, f"a flank of {line.words}")
            whole = replace(
                line,
                excluded=(*line.excluded, *flank.excluded),
                profiles=(*line.profiles, *flank.profiles),
            )
            view = view.without(flank, line).accept(whole)
            grown |= {key: whole for key, one in grown.items() if one is line} | {id(line): whole}
    return view


def _line_of(view: View, flank: Candidate, power: _Power) -> Candidate | None:
    """Return the line of which something is a flank: the nearest one, or several; None without."""
    lines = [
        (_distance(flank, one.effect), one, one.effect)
        for one in view.accepted
        if one is not flank and isinstance(one.effect, DriftingLine) and one.effect.spans
    ]
    lines = [near for near in lines if near[0] < _FAR * near[2].frequency.value]
    lines.sort(key=lambda near: near[0])
    expected, spans = 0.0, list[Span]()
    for number, (distance, _, line) in enumerate(lines, 1):
        reach = _FLANK * line.bandwidth.value / max(distance, line.bandwidth.value)
        expected += min(reach, _MOST) * line.sigma.value**2
        spans += line.spans
        is_nothing = not flank.effect.is_named and power.variance < _NOTHING * line.sigma.value**2
        if is_nothing or (power.variance < expected and _is_within(view, flank, power, spans)):
            return max(lines[:number], key=lambda near: near[2].sigma.value)[1]
    return None


def _is_within(view: View, flank: Candidate, power: _Power, spans: Sequence[Span]) -> bool:
    """Return whether something is there only in some stretches, to what is known of when."""
    if not flank.effect.spans:
        return power.is_within(view.rows_within(spans, power.blurred_s(view)))
    own = view.rows_within(flank.effect.spans)
    return not np.any(own & ~view.rows_within(spans, view.series.duration_s / FINEST))


def _is_edge(view: View, candidate: Candidate) -> bool:
    """Return whether noise is louder for a moment, in which a far louder line begins or ends."""
    effect = candidate.effect
    if not isinstance(effect, VarianceChange):
        return False
    first, last = effect.start.value, effect.stop.value
    loud = (c for c in view.accepted if c.gain * _FAINT_GAIN > candidate.gain)
    spans = [(a, b) for c in loud for a, b in c.effect.spans if last - first < _MOMENT * (b - a)]
    margin = view.series.duration_s / FINEST
    return any(first - margin < end < last + margin for span in spans for end in span)


def _may_be_flank(candidate: Candidate) -> bool:
    effect = candidate.effect
    if not isinstance(effect, Unexplained):
        return bool(effect.spans)
    return effect.is_tone or (effect.is_misfit and effect.figures["excess"] > 0)


def _distance(candidate: Candidate, line: DriftingLine) -> float:
    """Return how far the ranges of a candidate are from a line, in Hz."""
    at = line.frequency.value
    return min(max(low - at, at - high, 0.0) for low, high in candidate.excluded)
