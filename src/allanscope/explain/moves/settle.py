"""Move the shapes of bands, and of the processes beside them, to where they are likeliest together.

Bands that overlap and a low-pass that bends their skirts depend on each other: estimated in turn
(`moves.refit`) they take many turns, or end where none of them gains alone, with others in what
they leave. A band may have another form beside others than alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects.narrowband import BROADEST, Narrowband
from allanscope.explain.view import View
from allanscope.noise.components import Component, MovingLine
from allanscope.noise.evidence import Ordinates
from allanscope.noise.likelihood import Fit, Likelihood
from allanscope.noise.model import Free
from allanscope.noise.part import Part
from allanscope.noise.scoring import climb, other_forms

__all__ = ["settle", "was_measured"]

_WITHIN = 0.05
"""Gain of a step in nats at which it ends."""
_ANOTHER, _NEAR = 3.0, 3.0
"""Nats that another form of a band must gain, and distance from the band, in bandwidths, in which
what it leaves is looked for."""
_FAR, _FORMED = np.log(3.0), np.log(2.5)
"""Change of the logarithm of a bandwidth beyond which a band is another one, and that which another
form may bring."""

Places = dict[int, int]
"""Of a part of an effect, by its identity, the place among the parts of the model."""


def settle(view: View, *, forms: bool = True) -> View:
    """Return the view with the shapes of its processes at the maximum of their likelihood.

    It stays as it is where there are no two, or no band among them. What becomes another band, or
    is drawn to a line beside it, stays where it is. How well each number is known stays as it was.

    Parameters
    ----------
    view : View
        With the processes where they are now.
    forms : bool
        Whether a band may take another form, which takes most of the time.
    """
    movable = [c for c in view.accepted if _is_movable(c)]
    if not any(_band(part) is not None for c in movable for part in c.parts):
        return view
    places = _places(view)
    bands = tuple(c.band for c in view.model if c.band is not None)
    grid = view.grid.finer(bands)
    evidence = Ordinates(grid, *grid.binned(view.squares, view.excluded))
    start = Likelihood([evidence]).amplitudes(view.spectrum.model)
    while len(movable) > 1:
        shapes = [free for c in movable for free in _shapes(c, places)]
        fit = climb(start, shapes, _WITHIN)
        stayed = [c for c in movable if _has_stayed(c, fit, places)]
        if len(stayed) == len(movable):
            formed = _with_likeliest_forms(fit, movable, places) if forms else fit
            is_same = all(_has_stayed(c, formed, places) for c in movable)
            return _moved(view, movable, formed if is_same else fit, places)
        movable = stayed
    return view


def was_measured(candidate: Candidate) -> bool:
    """Return whether its form was read off the record: none that could be fitted would do."""
    moves = any(isinstance(part, MovingLine) for part in candidate.parts)
    return moves or bool(candidate.profiles)


def _is_movable(candidate: Candidate) -> bool:
    effect = candidate.effect
    is_one = effect.is_process and effect.stage == 2 and candidate.signal is None
    return is_one and bool(candidate.parts) and not was_measured(candidate)


def _places(view: View) -> Places:
    components = [part for part in view.parts if isinstance(part, Component)]
    filters = [part for part in view.parts if not isinstance(part, Component)]
    first = len(view.model.components) - len(components)
    return {id(part): place for place, part in enumerate([*components, *filters], first)}


def _shapes(candidate: Candidate, places: Places) -> list[Free]:
    """Return the shapes of an effect's parts that it has as well."""
    return [
        Free(places[id(part)], i)
        for part in candidate.parts
        for i, quantity in enumerate(part.quantities)
        if quantity.role == "shape" and getattr(candidate.effect, quantity.name, None) is not None
    ]


def _band(part: Part) -> tuple[float, float] | None:
    return part.band if isinstance(part, Component) else None


def _has_stayed(candidate: Candidate, fit: Fit, places: Places) -> bool:
    """Return whether bands and filters are in a fit what they were, and no band above the top."""
    top = fit.likelihood.evidence[0].frequency[-1]
    pairs = [(part, fit.model.parts[places[id(part)]]) for part in candidate.parts]
    bands = [band for _, part in pairs if (band := _band(part)) is not None]
    return all(_is_same(*pair, _FAR, fit.model.dt) for pair in pairs) and all(
        f0 < top for f0, _ in bands
    )


def _is_same(part: Part, other: Part, far: float, dt: float) -> bool:
    """Return whether a band is where another is, and about as wide; so of the corner of a filter.

    A filter alone has no corner where nothing is measured. Among bands it might be moved there, to
    be a slope that serves them.
    """
    old, new = _band(part), _band(other)
    if old is None or new is None:
        return isinstance(part, Component) or _is_near(part.corners(dt), other.corners(dt))
    (f0, width), (centre, wide) = old, new
    near = abs(centre - f0) <= max(width, wide) / 2
    return near and abs(np.log(wide / width)) <= far and wide <= BROADEST * centre


def _is_near(corners: Sequence[float], others: Sequence[float]) -> bool:
    return len(corners) == len(others) and all(
        abs(np.log(one / other)) <= _FAR for one, other in zip(corners, others, strict=True)
    )


def _with_likeliest_forms(fit: Fit, movable: Sequence[Candidate], places: Places) -> Fit:
    """Return the fit with other forms of bands, one after the other, where they gain enough."""
    shapes = [free for c in movable for free in _shapes(c, places)]
    for part in (part for c in movable for part in c.parts if _band(part) is not None):
        place = places[id(part)]
        if _left(fit, place) < _ANOTHER:
            continue
        best = fit
        for found in other_forms(fit, place, shapes, _WITHIN):
            pairs = zip(fit.model.parts, found.model.parts, strict=True)
            is_likelier = found.loglik > max(best.loglik, fit.loglik + _ANOTHER)
            if is_likelier and all(_is_same(*pair, _FORMED, fit.model.dt) for pair in pairs):
                best = found
        fit = best
    return fit


def _left(fit: Fit, place: int) -> float:
    """Return the nats, beyond what chance leaves, that any form could gain around a band."""
    band, evidence = fit.model.components[place].band, fit.likelihood.evidence[0]
    assert band is not None
    near = (np.abs(evidence.frequency - band[0]) < _NEAR * band[1]) & (evidence.dof > 0)
    ratio = evidence.power[near] / fit.expected[near]
    nats = evidence.dof[near] / 2 * (ratio - 1 - np.log(ratio)) - 0.5
    return float(nats.sum() - np.sqrt(len(nats) / 2))


def _sizes(candidate: Candidate, fit: Fit, places: Places) -> dict[str, Estimate]:
    """Return the rms of a band as it is in a fit, behind the filters."""
    if not isinstance(candidate.effect, Narrowband):
        return {}
    component = fit.model.components[places[id(candidate.parts[0])]]
    if component.power == 0.0:  # the others have taken it over: it will be dropped
        return {}
    sigma, centre = candidate.effect.sigma, candidate.effect.frequency.value
    return {"sigma": sigma.scaled(fit.model.amplitude_behind(component, centre) / sigma.value)}


def _moved(view: View, movable: Sequence[Candidate], fit: Fit, places: Places) -> View:
    """Return the view with processes as they are in a fit."""
    parts: dict[int, Part] = {}
    moved: dict[int, Candidate] = {}
    for candidate in movable:
        for old in candidate.parts:
            new = fit.model.parts[places[id(old)]]
            if isinstance(old, Component) and isinstance(new, Component):
                new = new.with_power(old.power)
            parts[id(old)] = new
        fields: dict[str, Any] = _sizes(candidate, fit, places)
        for free in _shapes(candidate, places):
            name, number = fit.model.quantity(free).name, fit.model.number(free)
            known = getattr(candidate.effect, name)
            is_known = isinstance(known, Estimate)
            fields[name] = known.scaled(number / known.value) if is_known else number
        effect = replace(candidate.effect, **fields)
        own = tuple(parts[id(part)] for part in candidate.parts)
        moved[id(candidate)] = replace(candidate, effect=effect, parts=own)
    return view.changed(
        parts=tuple(parts.get(id(part), part) for part in view.parts),
        accepted=tuple(moved.get(id(c), c) for c in view.accepted),
    )
