"""Replace what was left out of the fit by the lines that are in it.

While the search goes on, a tone that changes is left out of the fit together with all that touches
it. Once everything else is known, the noise beside it is known too, and what was left out can be
looked at: clusters of loud ordinates become lines, most of which drift, and what is between them
returns to the fit. What is no line is noise in a band, if nothing speaks against it, or stays
`unexplained`, with the size and the distribution of its power.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import ALPHA, Candidate
from allanscope.explain.effects.drifting_line import (
    Cluster,
    DriftingLine,
    clusters,
    core,
    drifting_line,
    excess,
    gain_of,
    lines_of,
    profile_of,
    range_of,
)
from allanscope.explain.effects.sinusoid import constant_line
from allanscope.explain.effects.unexplained import Unexplained, tone_without_name
from allanscope.explain.moves import SearchPath
from allanscope.explain.moving_band import moving_band, noise_between
from allanscope.explain.view import View
from allanscope.median import median
from allanscope.quantities import CHI_SQUARE_MEDIAN

__all__ = ["resolve_tones"]

Array = NDArray[np.float64]

_FAMILY = 0.03
"""Width over frequency up to which the clusters of a range are one line."""
_WIDE = 1.5
"""Ratio of its ends from which a range without a name is no line."""
_MOST = 0.8
"""Share of the power in a range that its clusters must hold: else it is one thing."""
_HELD, _NARROW = 0.4, 0.02
"""Share of the power of a range that a line holds beside which the rest is something else, and of
its width that the line may have."""
_OF_A_SLOPE = 0.1
"""Power of the slopes of a line beyond its flanks over that of the line, at the most."""
_SLOPE, _FLANK = 3.0, 8
"""Power over that of the range beside it down to which the flank of a line reaches, and its longest
one in widths of the core."""
_LEVEL, _SURELY = 0.5, 3.0
"""Excess over the noise, and that in standard errors, up to which the ends of a range are level."""
_MAIN = 0.5
"""Share of their power that one of several clusters holds which may be a band by itself."""
_GAP, _SOME = 0.2, 0.05
"""Share of a range that has no cluster in it, from which it is no band; and share of the power that
a cluster which counts there has at the least."""
_FEW = 16
"""Ordinates of a line that is constant, with those that its ends leak into, at the most."""
_FAINT = 0.01
"""Gain over that of a line within a bandwidth of it, from which a part is more than its tail."""


def resolve_tones(view: View, path: SearchPath) -> View:
    """Return the view with every tone that was left out resolved into what it is."""
    tones = [c for c in view.accepted if isinstance(c.effect, Unexplained) and c.effect.is_tone]
    beside: list[tuple[Candidate, Candidate]] = []
    for whole in tones:  # which grows
        assert isinstance(whole.effect, Unexplained)
        low, high = whole.effect.limits
        parts = clusters(view, low, high)
        band = _without_level_ends(view, range_of(view, low, high), parts)
        low, high = _frequency(view, band.first), _frequency(view, band.stop)
        # A carrier and its sidebands; or so near to each other that they will be.
        is_one = len(whole.excluded) > 1 or high - low < _FAMILY * high
        if is_one or excess(view, *parts) < _MOST * excess(view, band):
            parts = [band]
        if not is_one:
            parts = [one for part in parts for one in lines_of(view, part)]
        path.evaluations += len(parts)
        if path.is_spent:
            path.stop("drifting lines")
            parts = [band]
        found = _found(view, parts, band, whole)
        split: list[Candidate] = []
        place = core(view, band, _HELD)
        if not (is_one or path.is_spent or _is_settled(view, place, found)):
            split = _line_and_rest(view, parts, band, place, whole)
            found = split or found
        if any(_is_slope(found, line) for part, line in beside if part is whole):
            found = [_without_name(view, band, whole)]
        else:
            beside += [(part, split[0]) for part in split[1:]]
            tones += split[1:]  # looked at again beside the line
        view = view.without(whole)
        for one in found:
            path.note("resolve", one, "accepted")
            view = view.accept(one)
    return view


def _is_settled(view: View, place: Cluster, found: list[Candidate]) -> bool:
    """Return whether a range has a name, that of a single line only in the place of its core."""
    named = [c.effect for c in found if c.effect.is_named]
    if len(named) != 1 or not isinstance(named[0], DriftingLine):
        return bool(named)
    flank = place.stop - place.first
    low, high = _frequency(view, place.first - flank), _frequency(view, place.stop + flank)
    return low < named[0].frequency.value < high


def _is_slope(found: list[Candidate], line: Candidate) -> bool:
    """Return whether lines beside a louder one are no more than the slope of that."""
    sizes = [c.effect.sigma.value for c in found if isinstance(c.effect, DriftingLine)]
    assert isinstance(line.effect, DriftingLine)
    return bool(sizes) and max(sizes) ** 2 < _OF_A_SLOPE * line.effect.sigma.value**2


def _line_and_rest(
    view: View, parts: list[Cluster], band: Cluster, place: Cluster, whole: Candidate
) -> list[Candidate]:
    """Return the line that holds much of the power of a range, and what is beside it without names.

    `place` is the core of the range. It is one though bursts of broad noise all around it were left
    out with it. Nothing where no line is so loud, or it is a part of its own.
    """
    around = (p for p in parts if p.first < place.stop and place.first < p.stop)
    widest = max((part.stop - part.first for part in around), default=0)
    if place.stop - place.first > _NARROW * widest:
        return []
    place = _with_flanks(view, place, band)
    line = drifting_line(view, place, whole)
    if line is None:
        return []
    beside = Cluster(band.first, place.first), Cluster(place.stop, band.stop)
    rest = (_without_name(view, part, whole) for part in beside if part.stop > part.first)
    return [line, *(part for part in rest if not _is_tail(part, [line]))]


def _with_flanks(view: View, place: Cluster, band: Cluster) -> Cluster:
    """Return the core of a line in a range with its flanks, down to what else is there.

    That is told by the median of the range. Of a tone whose phase wanders a tenth of the power is
    farther away than nine times half the width of such a core.
    """
    size = place.stop - place.first
    squares = view.squares[band.first : band.stop]
    level = _SLOPE * median(squares) / CHI_SQUARE_MEDIAN

    def reach(outward: Array) -> int:
        whole = min(len(outward) // size, _FLANK)
        blocks = outward[: whole * size].reshape(whole, size).mean(axis=1)
        loud = int(np.argmin(np.append(blocks, 0.0) > level))
        return max(loud * size, min(size // 2, len(outward)))

    before, after = squares[: place.first - band.first][::-1], squares[place.stop - band.first :]
    return Cluster(place.first - reach(before), place.stop + reach(after))


def _found(view: View, parts: list[Cluster], band: Cluster, whole: Candidate) -> list[Candidate]:
    """Return what a range is made of: lines, bands, and parts without a name."""
    named = [drifting_line(view, part, whole) or _constant(view, part, whole) for part in parts]
    if not all(named):
        power = [excess(view, part) for part in parts]
        loud = [p for p, own in zip(parts, power, strict=True) if own > _SOME * sum(power)]
        main = int(np.argmax(power))
        if not _is_gapped(loud) and (one := moving_band(view, band, whole)) is not None:
            return [one]  # noise has clusters too, by chance
        if len(parts) > 1 and named[main] is None and power[main] > _MAIN * sum(power):
            named[main] = moving_band(view, parts[main], whole)
            if named[main] is not None:
                named = [
                    name or _on_slope(view, part, whole, parts[main])
                    for name, part in zip(named, parts, strict=True)
                ]
    if not any(named):
        return [noise_between(view, band, whole) or _without_name(view, band, whole)]
    known = [name for name in named if name is not None]
    rest = [
        _without_name(view, part, whole)
        for part, name in zip(parts, named, strict=True)
        if name is None
    ]
    return [*known, *(part for part in rest if not _is_tail(part, known))]


def _constant(view: View, part: Cluster, whole: Candidate) -> Candidate | None:
    """Return the line that does not drift which a narrow part is; None where it is none."""
    is_narrow = part.stop - part.first <= _FEW
    return constant_line(view.without(whole), part.first, part.stop) if is_narrow else None


def _on_slope(view: View, part: Cluster, whole: Candidate, band: Cluster) -> Candidate | None:
    """Return the line on the slope of a known band that a part beside it is, or that it holds."""
    found = drifting_line(view, part, whole, band)
    return found or drifting_line(view, core(view, part), whole, band)


def _is_gapped(parts: list[Cluster]) -> bool:
    """Return whether there is nothing in so much of a range that it is no one thing."""
    gaps = [b.first - a.stop for a, b in pairwise(parts)]
    return bool(gaps) and max(gaps) > _GAP * (parts[-1].stop - parts[0].first)


def _without_level_ends(view: View, band: Cluster, parts: list[Cluster]) -> Cluster:
    """Return the range from its first cluster to its last, if nothing is beyond these.

    When it was left out less was known of the noise, and it may have been taken for too wide.
    """
    if not parts:
        return band
    hull = Cluster(parts[0].first, parts[-1].stop)
    beyond = Cluster(band.first, hull.first), Cluster(hull.stop, band.stop)
    noise = sum(float(view.spectrum.ordinates[one.first : one.stop].sum()) for one in beyond)
    count = max(1, sum(one.stop - one.first for one in beyond))
    level = min(_LEVEL, _SURELY * math.sqrt(2.0 / count))
    return hull if excess(view, *beyond) < level * noise else band


def _frequency(view: View, ordinate: int) -> float:
    return (ordinate + 1) * view.grid.rate_hz / (2 * view.grid.n)


def _is_tail(part: Candidate, lines: list[Candidate]) -> bool:
    """Return whether a part without a name is nothing, or the tail of a line beside it."""
    (low, high), *_ = part.excluded
    return part.gain < -math.log(ALPHA) or any(
        part.gain < _FAINT * line.gain
        and low < line.effect.frequency.value + line.effect.bandwidth.value
        and high > line.effect.frequency.value - line.effect.bandwidth.value
        for line in lines
        if isinstance(line.effect, DriftingLine)
    )


def _without_name(view: View, cluster: Cluster, whole: Candidate) -> Candidate:
    profile, error = profile_of(view, cluster)
    left = tone_without_name(
        view, profile, error, replace(whole, gain=gain_of(view, cluster, profile))
    )
    # What is wider is left to the smooth remainder: equal sub-bands are too coarse at its low end.
    return replace(left, profiles=(profile,)) if profile.high < _WIDE * profile.low else left
