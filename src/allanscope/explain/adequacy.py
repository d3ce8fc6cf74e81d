"""Whether a candidate is what it says: measured, there all along, and most of a residual."""

from __future__ import annotations

import numpy as np

from allanscope.explain.bent_by_temperature import bent_by_temperature
from allanscope.explain.candidate import Candidate
from allanscope.explain.effects.unexplained import tone_left_over
from allanscope.explain.residual import band_scores
from allanscope.explain.steadiness import reach_of, unsteadiness_of
from allanscope.explain.view import View

__all__ = ["adequate", "is_measured", "lasting", "removes"]


def adequate(view: View, candidate: Candidate) -> Candidate | None:
    """Return the candidate, `unexplained` in its place, or None."""
    if not is_measured(candidate) or not candidate.effect.is_resolved(view):
        return None
    if candidate.effect.resembles_bend:
        curve = bent_by_temperature(view, candidate)
        if curve is not None:
            return curve
    return candidate.effect.adequate(view, candidate)


def is_measured(candidate: Candidate) -> bool:
    """Tell whether every number has an interval that is one: finite, and wider than nothing.

    Without it the likelihood has no maximum there in some direction, so nothing has been measured.
    Counts and instants may be known exactly.
    """
    effect = candidate.effect
    return not (effect.is_process or effect.is_fitted) or all(
        p.lower is not None and p.upper is not None and p.lower < p.upper < np.inf
        for p in effect.parameters.values()
    )


def lasting(view: View, process: Candidate, most_sigma: float = float("inf")) -> Candidate | None:
    """Return a process that removes its part of the residual and is there all along.

    One that comes and goes by more than so many sigma is a tone that sweeps, and has no name.
    """
    if not removes(view, process):
        return None
    if most_sigma == float("inf") or unsteadiness_of(view, process) <= most_sigma:
        return process
    _, high = reach_of(view, process)
    return tone_left_over(view, process, high / 2, high / 2)


def removes(view: View, candidate: Candidate) -> bool:
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
