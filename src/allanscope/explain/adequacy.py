"""Whether a candidate is what it says: one line all along, noise in a band, most of a residual."""

from __future__ import annotations

import numpy as np

from allanscope.explain.bent_by_temperature import bent_by_temperature
from allanscope.explain.candidate import Candidate
from allanscope.explain.effects import KINDS
from allanscope.explain.effects.unexplained import beside, tone_left_over
from allanscope.explain.residual import band_scores
from allanscope.explain.steadiness import UNSTEADY, as_band, unsteadiness_of
from allanscope.explain.tones import evenness, sweeps, unsteadiness
from allanscope.explain.view import View

__all__ = ["CONSTANT_P", "WITHIN", "adequate", "is_measured"]

_FITTED = ("random_telegraph", "sinusoid")
_LASTING = {"gauss_markov": UNSTEADY, "band_limit": 2 * UNSTEADY}
"""Sigma by which these may come and go; with more, a filter is what a tone in it bends."""
CONSTANT_P = 1e-5
"""Chance below which the parts of a line differ too much to be one line."""
_FEWEST_COHERENCES = 12.0
"""Fewer coherence times in a record cannot show that a band holds noise."""
_UNSTEADY = 6.0
"""Sigma; noise in bands of any width stayed below 2 in some hundred records."""
_TOO_EVEN, _MISSHAPEN, _MISSED = 5.0, 6.0, 0.02
"""Sigma of the envelope; sigma and share of the gain of what a band leaves: beyond all three it is
a tone whose frequency moves."""
_SUB_BANDS = 64
WITHIN = 3.0
"""Distance in bandwidths up to which a frequency belongs to a band."""


def adequate(view: View, candidate: Candidate) -> Candidate | None:
    """Return the candidate, `unexplained` in its place, or None."""
    is_line = candidate.kind == "sinusoid"
    if not is_measured(candidate) or (is_line and _is_unresolved(view, candidate)):
        return None
    if (curve := bent_by_temperature(view, candidate)) is not None:
        return curve
    if is_line or candidate.kind == "narrowband":
        return candidate if _is_steady(view, candidate) else tone_left_over(view, candidate)
    return _lasting_process(view, candidate) if KINDS[candidate.kind].is_process else candidate


def _lasting_process(view: View, process: Candidate) -> Candidate | None:
    """Return a process that removes its part of the residual and is there all along."""
    if not _removes(view, process):
        return None
    lasting = _LASTING.get(process.kind)
    if lasting is None or unsteadiness_of(view, process) <= lasting:
        return process
    is_filter = process.kind == "band_limit"
    return None if is_filter else tone_left_over(view, as_band(view, process))


def is_measured(candidate: Candidate) -> bool:
    """Tell whether every number has an interval that is one: finite, and wider than nothing.

    Without it the likelihood has no maximum there in some direction, so nothing has been measured.
    """
    numbers = [p for p in candidate.parameters.values() if not isinstance(p.value, str)]
    if not KINDS[candidate.kind].is_process and candidate.kind not in _FITTED:
        return True  # counts and instants may be known exactly
    return all(
        p.lower is not None and p.upper is not None and p.lower < p.upper < np.inf for p in numbers
    )


def _is_unresolved(view: View, line: Candidate) -> bool:
    """Tell whether a line is nearer to one there is than the record resolves.

    Two such lines of opposite phase are any slow bend at all: they cancel except at the ends.
    """
    near = 1 / view.series.duration_s
    return any(
        c.kind == "sinusoid" and abs(c.shape[0] - line.shape[0]) < near for c in view.accepted
    )


def _is_steady(view: View, tone: Candidate) -> bool:
    """Tell whether a line is one line all along, or a band holds noise all along."""
    if beside(view, tone):
        return False
    if tone.kind == "sinusoid":
        return bool(tone.evidence["constancy_p"] >= CONSTANT_P)
    rate, (f0, width) = view.grid.rate_hz, tone.shape[:2]
    return (
        width * view.series.duration_s >= _FEWEST_COHERENCES
        and unsteadiness(view.data, rate, f0, width) < _UNSTEADY
        and unsteadiness_of(view, tone) < UNSTEADY
        and not sweeps(view.data, rate, f0, width)
        and not (evenness(view.data, rate, f0, width) > _TOO_EVEN and _is_misshapen(view, tone))
        and _removes(view, tone)
    )


def _is_misshapen(view: View, band: Candidate) -> bool:
    """Tell whether the spectrum within a band differs from the shape that was fitted."""
    after = view.with_parts(*band.parts)
    f0, width = band.shape[:2]
    near = np.flatnonzero(np.abs(view.grid.frequency - f0) < WITHIN * width)
    parts = np.array_split(near, min(_SUB_BANDS, max(1, len(near) // 8)))
    u = after.squares / after.spectrum.ordinates
    ratio = np.array([u[part].mean() for part in parts])
    count = np.array([len(part) for part in parts])
    left = float(np.sum(count * (ratio - 1 - np.log(ratio)) - 1)) / 2
    return bool(left > max(_MISSHAPEN * np.sqrt(len(parts) / 2), _MISSED * band.gain))


def _removes(view: View, candidate: Candidate) -> bool:
    """Tell whether most of the residual is gone where the candidate changes the spectrum most."""
    after = view.with_parts(*candidate.parts)
    bands = band_scores(view)
    later = band_scores(after)
    change = np.abs(np.log(after.spectrum.at(bands.frequency) / view.spectrum.at(bands.frequency)))
    weight = change * np.sqrt(bands.count)
    own = weight > 0.5 * weight.max()
    if not own.any():
        return False
    first = float(np.sqrt(np.mean(bands.z[own] ** 2)))
    second = float(np.sqrt(np.mean(later.z[own] ** 2)))
    return second < max(3.0, 0.5 * first)
