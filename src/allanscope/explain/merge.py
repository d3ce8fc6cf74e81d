"""The same physical effect on several axes is named once, with all its axes.

A line of one frequency, a step of one instant, a warm-up of one time constant, a drift, a burst:
where the intervals of two axes overlap in what locates the effect, each names the other, and for
what happens once in a record a second axis is the replication that time cannot give.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Parameter
from allanscope.explain.view import View

__all__ = ["merged"]

_TOLERANCE = 1e-4
"""Relative difference that counts as equal even where both intervals are narrower."""


def merged(views: Mapping[str, View]) -> dict[str, View]:
    """Return the views with the axes of every effect filled in."""
    out = {}
    for axis, view in views.items():
        accepted = tuple(_with_axes(candidate, axis, views) for candidate in view.accepted)
        out[axis] = replace(view, accepted=accepted)
    return out


def _with_axes(candidate: Candidate, axis: str, views: Mapping[str, View]) -> Candidate:
    key = candidate.effect.shared_by
    if not key:
        return candidate
    axes = tuple(
        other
        for other, view in views.items()
        if other == axis
        or any(c.kind == candidate.kind and _same(c, candidate, key) for c in view.accepted)
    )
    held = candidate.held_out
    if len(axes) > 1 and held is not None and held.replicated is None:
        held = HeldOut(held.nats, held.error, f"{held.design}; seen on {len(axes)} axes", True)
    return replace(candidate, axes=axes, held_out=held)


def _same(first: Candidate, second: Candidate, key: str) -> bool:
    a, b = first.effect.parameters[key], second.effect.parameters[key]
    (a_low, a_high), (b_low, b_high) = _limits(a), _limits(b)
    return a_low <= b_high and b_low <= a_high


def _limits(parameter: Parameter) -> tuple[float, float]:
    assert isinstance(parameter.value, float)
    room = _TOLERANCE * abs(parameter.value)
    low = parameter.value if parameter.lower is None else parameter.lower
    high = parameter.value if parameter.upper is None else parameter.upper
    return min(low, parameter.value - room), max(high, parameter.value + room)
