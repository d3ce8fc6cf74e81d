"""All slow deterministic effects in one regression, the noise refitted along with them.

A warm-up that is fitted alone takes along what belongs to the temperature, and the temperature that
is fitted to the rest then fails in the quarter where the warm-up was. One regression shares the
level between them as the data do, gives each the error that it has beside the others, and tells
what each gains when all others are free to take its place.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.regression import joint_fit, marginal_covariance
from allanscope.explain.view import View

__all__ = ["refit_jointly"]

Array = NDArray[np.float64]

_TURNS = 12
_SETTLED = 3e-3
"""Largest relative change of a time constant in the last turn."""


def refit_jointly(view: View) -> View:
    """Estimate the slow deterministic effects of a view again, all at once.

    A view with fewer than two of them is returned as it is.
    """
    members = [c for c in view.accepted if c.effect.columns(view) is not None]
    if len(members) < 2:
        return view
    bare = view.without(*members)
    found = members
    for _ in range(_TURNS):
        before, found = found, _solved(bare, found)
        if _moved(before, found) < _SETTLED:
            break
    found = _with_gains(bare, found)
    grown = bare
    for candidate in found:
        grown = grown.accept(candidate)
    places = {id(old): new for old, new in zip(members, found, strict=True)}
    return replace(grown, accepted=tuple(places.get(id(c), c) for c in view.accepted))


def _columns(view: View, candidate: Candidate) -> Array:
    columns = candidate.effect.columns(view)
    assert columns is not None
    return columns


def _solved(bare: View, members: list[Candidate]) -> list[Candidate]:
    """Take one Gauss-Newton step of all numbers of all members."""
    parts = [_columns(bare, c) for c in members]
    fit = joint_fit(bare, np.vstack(parts))
    covariance = marginal_covariance(bare, np.vstack(parts), fit)
    ends = np.cumsum([len(part) for part in parts])
    found = []
    for candidate, part, end in zip(members, parts, ends, strict=True):
        own = slice(int(end) - len(part), int(end))
        amplitude, error = fit.amplitude[own], covariance[own, own]
        found.append(candidate.effect.solved(bare, candidate, amplitude, error))
    return found


def _moved(before: list[Candidate], after: list[Candidate]) -> float:
    """Return the largest relative change of what the regression is not linear in."""
    times = [[c.effect.relaxation_s for c in members] for members in (before, after)]
    return max((abs(b / a - 1) for a, b in zip(*times, strict=True) if a and b), default=0.0)


def _with_gains(bare: View, members: list[Candidate]) -> list[Candidate]:
    """Give every member what it gains beside the others, these fitted again without it."""
    parts = [_columns(bare, c) for c in members]
    whole = joint_fit(bare, np.vstack(parts)).gain
    found = []
    for k, candidate in enumerate(members):
        others = np.vstack(parts[:k] + parts[k + 1 :])
        found.append(replace(candidate, gain=whole - joint_fit(bare, others).gain))
    return found
