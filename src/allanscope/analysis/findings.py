"""Findings: the effects of all axes, with what is one disturbance put together.

The search works axis by axis and line by line. A pump that shakes the board is then a dozen effects
of one cause. Two effects are one finding where they

- are of one kind, on two axes, and agree in what tells effects of this kind apart: the frequency,
  the time, the source, the range; or, where a kind has no place, in all of their numbers, unless
  the board has one cause of it, as it has one temperature;
- are lines of which one is a harmonic of the other, or sits in the other's band;
- are lines of which one is made of the other, or of two: a harmonic beyond the Nyquist frequency,
  seen folded about the sample clock, a sideband, a sum, an image (`line_families`);
- are four or more lines at multiples of a frequency at which nothing is seen (`combs`);
- are narrow bands on two axes that overlap, or a line and a narrow band without a name about it;
- begin or end at one time: a step, an excursion and a burst.

Agreement is by their intervals. Two that only share that they have no name are two findings.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from allanscope.analysis.combs import fundamental_of
from allanscope.analysis.line_families import Line, relations_of
from allanscope.explain import Effect, Parameter

if TYPE_CHECKING:
    from allanscope.analysis.coherence import Leak
    from allanscope.analysis.direction import Motion
    from allanscope.analysis.line_origin import LineOrigin

__all__ = ["UNEXPLAINED", "Comb", "Finding", "Member", "event_times", "findings_of", "line_of"]

UNEXPLAINED = "unexplained"
"""Kind of what was measured and located, and has no name."""

_WIDER = 2.0
"""Intervals are stretched by this: of many pairs of 95 % intervals some would miss each other."""
_RELATIVE = 1e-4
"""Relative difference that counts as equal even where intervals are narrower."""
_MUCH_WIDER, _BROAD = 10.0, 0.05
"""Ratio of two bandwidths, and width over frequency, from which a line on one axis is not the
resonance on another that it lies in."""
_HIGHEST = 40
"""Highest order of a harmonic."""
_BY_CHANCE = 0.02
"""Largest uncertainty of an order; beyond, any line would be a harmonic of any other."""
_OFF = 0.1
"""How far an order of a comb may be from a whole number, as a line of a family may."""
_NARROW = 0.1
"""Relative width up to which a range of frequencies is taken for one line."""
_TIMES = 2.0
"""Ratio up to which numbers of what has no place agree, however little is known of them: dwell
times of 8 s and of 80 s, from a dozen hops, are those of two signals."""
_AT_ONCE_S = 1.0
"""Time within which events are one: a knock and what it leaves behind."""


class Comb(NamedTuple):
    """Lines at multiples of one frequency at which nothing is seen.

    Attributes
    ----------
    fundamental_hz : float
        The largest of which all are multiples.
    orders : tuple of int
        Ascending.
    """

    fundamental_hz: float
    orders: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Member:
    """One effect of a finding: the axis, and its place among the effects of that axis."""

    axis: str
    index: int
    effect: Effect


@dataclass(frozen=True, slots=True)
class Finding:
    """One disturbance, however many effects it is.

    Attributes
    ----------
    kind : str
        That of its leading effect: the fundamental of lines, else what gained most of those that
        have a name.
    axes : tuple of str
        Where it was seen.
    members : tuple of Member
        Its effects, the leading one first.
    gain_nats : float
        Log-likelihood that they gained together.
    harmonics : tuple of int
        Orders beside the fundamental, ascending.
    share : float
        What its effects hold of the excess of all axes over sampling error; NaN where none is
        known. Findings are sorted by it, those without a name after the others.
    folded : tuple of int
        Orders of the harmonics among them that are seen folded about the sample rate.
    mixed : tuple of str
        What the other lines are of the fundamental f and the sample rate fs: ``f + 1.2 Hz``,
        ``fs/2 - f``; or the frequency of a line that f is mixed with.
    comb : Comb or None
        The frequency at which nothing is seen, of which all its lines are multiples.
    origin : LineOrigin or None
        Where a line comes from; None of what is no line, and while a run goes on.
    motion : Motion or None
        The direction of a line, a step, an excursion or a burst.
    leak : Leak or None
        The direction of a cross-coupling, where lines tell what noise does not.
    """

    kind: str
    axes: tuple[str, ...]
    members: tuple[Member, ...]
    gain_nats: float
    harmonics: tuple[int, ...] = field(default=())
    share: float = math.nan
    folded: tuple[int, ...] = ()
    mixed: tuple[str, ...] = ()
    comb: Comb | None = None
    origin: LineOrigin | None = None
    motion: Motion | None = None
    leak: Leak | None = None


def findings_of(
    effects: Mapping[str, Iterable[Effect]],
    excess_nats: Mapping[str, float] | None = None,
    rate_hz: float = 0.0,
) -> tuple[Finding, ...]:
    """Return the findings: those with a name first, each by its share, the largest first.

    Parameters
    ----------
    effects : mapping
        Axis to its effects, in the order of the result. Those of the stream are left out.
    excess_nats : mapping, optional
        Axis to its excess over sampling error (`Shares.excess_nats`), of which effects have shares.
    rate_hz : float
        Sample rate about which lines fold and mix; 0 to join none that do.
    """
    excess = excess_nats or {}
    members = [
        Member(axis, index, effect)
        for axis, here in effects.items()
        for index, effect in enumerate(here)
        if not effect.traits.of_the_stream
    ]
    group = list(range(len(members)))
    for i, j in combinations(range(len(members)), 2):
        if group[i] != group[j] and _is_one(members[i], members[j]):
            kept, gone = sorted((group[i], group[j]))
            group = [kept if one == gone else one for one in group]
    whole = [
        _finding(
            [m for m, of in zip(members, group, strict=True) if of == one], list(effects), excess
        )
        for one in dict.fromkeys(group)
    ]
    found = _with_families(whole, list(effects), excess, rate_hz) if rate_hz else whole
    found = _with_combs(found, list(effects), excess)
    return tuple(sorted(found, key=_order))


def _with_families(
    found: list[Finding], axes: list[str], excess: Mapping[str, float], rate_hz: float
) -> list[Finding]:
    """Join lines that are made of others to their fundamental."""
    places = [at for at, one in enumerate(found) if one.kind == "sinusoid"]
    lines = []
    for at in places:
        known = line_of(found[at].members[0].effect) or (0.0, 0.0, 0.0, 0.0)
        lines.append(Line(*known[:3], found[at].gain_nats))
    joined = dict(enumerate(found))
    for one in relations_of(lines, rate_hz):
        at = places[one.bases[0]]
        base, product = joined[at], joined.pop(places[one.product])
        order = (one.order,) if one.order else ()
        joined[at] = replace(
            _joined([base, product], axes, excess),
            harmonics=tuple(sorted({*base.harmonics, *order})),
            folded=tuple(sorted({*base.folded, *order})),
            mixed=(*base.mixed, one.words) if one.words else base.mixed,
        )
    return list(joined.values())


def _with_combs(
    found: list[Finding], axes: list[str], excess: Mapping[str, float]
) -> list[Finding]:
    """Join lines that are multiples of one frequency to the one of them that gained most."""
    kinds = ("sinusoid", "drifting_line")
    lines = [at for at, one in enumerate(found) if one.kind in kinds and one.comb is None]
    value, error = np.array([_surest(found[at]) for at in lines]).reshape(-1, 2).T
    seen = fundamental_of(value, error)
    if seen is None:
        return found
    base, places = seen
    parts = sorted((found[lines[at]] for at in places), key=lambda one: -one.gain_nats)
    whole = _joined(parts, axes, excess)
    lines_hz = [known[0] for one in whole.members if (known := line_of(one.effect)) is not None]
    orders = {round(one / base): abs(one / base - round(one / base)) for one in lines_hz}
    comb = Comb(base, tuple(sorted(one for one, off in orders.items() if off < _OFF)))
    whole = replace(whole, harmonics=(), folded=(), mixed=(), comb=comb)
    others = [one for one in found if all(one is not part for part in parts)]
    return _with_combs([*others, whole], axes, excess)


def _joined(parts: Sequence[Finding], axes: list[str], excess: Mapping[str, float]) -> Finding:
    """Return the first of some findings with the effects of all."""
    members = [member for one in parts for member in one.members]
    seen_on = {member.axis for member in members}
    return replace(
        parts[0],
        axes=tuple(axis for axis in axes if axis in seen_on),
        members=tuple(members),
        gain_nats=sum(one.gain_nats for one in parts),
        share=_share(members, excess),
    )


def _surest(lines: Finding) -> tuple[float, float]:
    """Return the frequency of a finding and how far it may be off, from what knows it best."""
    base = _value(lines.members[0].effect, "frequency")
    known = []
    for member in lines.members:
        value, lower, upper, width = line_of(member.effect) or (0.0, 0.0, 0.0, 0.0)
        order, room = max(1, round(value / base)), (_WIDER * (upper - lower) + width) / 2
        if abs(value - order * base) <= _BY_CHANCE * base:
            known.append((room / order, value / order))
    error, value = min(known)
    return value, error


def _order(finding: Finding) -> tuple[bool, float, float]:
    share = 0.0 if math.isnan(finding.share) else finding.share
    return finding.kind == UNEXPLAINED, -share, -finding.gain_nats


def _finding(members: list[Member], axes: list[str], excess: Mapping[str, float]) -> Finding:
    members = sorted(members, key=lambda one: (one.effect.kind == UNEXPLAINED, -_gain(one.effect)))
    lines = [one for one in members if _frequency(one.effect) is not None]
    orders: set[int] = set()
    if len(lines) == len(members):
        lowest = min(lines, key=lambda one: _value(one.effect, "frequency"))
        base = _value(lowest.effect, "frequency")
        order = {id(one): max(1, round(_value(one.effect, "frequency") / base)) for one in members}
        members.sort(key=lambda one: (order[id(one)], -_gain(one.effect)))
        orders = set(order.values()) - {1}
    seen = {one.axis for one in members}
    return Finding(
        kind=members[0].effect.kind,
        axes=tuple(axis for axis in axes if axis in seen),
        members=tuple(members),
        gain_nats=sum(_gain(one.effect) for one in members),
        harmonics=tuple(sorted(orders)),
        share=_share(members, excess),
    )


def _share(members: list[Member], excess: Mapping[str, float]) -> float:
    """Return what effects hold of the excess of all axes."""
    total = sum(excess.values())
    held = [
        one.effect.share * excess.get(one.axis, 0.0)
        for one in members
        if not math.isnan(one.effect.share)
    ]
    return sum(held) / total if total > 0 and held else math.nan


def _gain(effect: Effect) -> float:
    gain = effect.evidence.get("gain_nats")
    return float(gain) if isinstance(gain, (int, float)) else 0.0


def _is_one(first: Member, second: Member) -> bool:
    """Return whether two effects are one disturbance."""
    a, b = first.effect, second.effect
    on_one_axis = first.axis == second.axis
    if _is_harmonic(a, b, on_one_axis) or _at_once(a, b) or _is_in_band(a, b) or _is_in_band(b, a):
        return True
    if a.kind != b.kind or on_one_axis:  # where a warm-up may have two time constants
        return a.kind == b.kind and a.traits.is_single
    source, other = a.parameters.get("source"), b.parameters.get("source")
    if source is not None and other is not None:
        mutual = (source.value, other.value) == (second.axis, first.axis)
        return mutual or source.value == other.value
    bands = _narrow_band(a), _narrow_band(b)
    if bands[0] and bands[1]:
        return max(bands[0][0], bands[1][0]) <= min(bands[0][1], bands[1][1])
    where = a.traits.located_by
    # Power without a name names the axes that go along with it.
    goes_along = a.kind == UNEXPLAINED and second.axis in a.axes and first.axis in b.axes
    if goes_along or (not where and (a.traits.has_one_cause or second.axis in a.axes)):
        return True
    if where:
        unit = a.parameters[where].unit if where in a.parameters else ""
        shared = [n for n, p in a.parameters.items() if p.unit == unit and _places(n, where)]
    else:
        shared = list(a.parameters)
    return bool(shared) and all(
        name in b.parameters
        and _agree(a.parameters[name], b.parameters[name])
        and (bool(where) or _alike(a.parameters[name], b.parameters[name]))
        for name in shared
    )


def _places(name: str, where: str) -> bool:
    """Return whether a parameter says where an effect is: both ends of a range do."""
    return name == where or (where.endswith("_low") and name == f"{where[:-4]}_high")


def _is_harmonic(a: Effect, b: Effect, on_one_axis: bool) -> bool:
    """Return whether two lines have one frequency, or one is a multiple of the other.

    What wanders over a bandwidth has harmonics that wander over multiples of it: a resonance much
    wider than that is near a multiple of a slow line, or has a line of another axis within it, by
    chance.
    """
    low, high = _frequency(a), _frequency(b)
    if low is None or high is None:
        return False
    if low.value > high.value:
        a, b, low, high = b, a, high, low
    if min(low.value, high.value) <= 0:
        return False
    order = round(high.value / low.value)
    room = order * _half(low) + _half(high)
    apart = abs(high.value - order * low.value)
    widths = [_value(e, "bandwidth") for e in (a, b) if "bandwidth" in e.parameters]
    if order == 1:
        least, widest = sorted([0.0, 0.0, *widths])[-2:]
        is_broad = widest > max(_MUCH_WIDER * least, _BROAD * high.value)
        is_in_another = is_broad and not on_one_axis
        return apart <= room + (0.0 if is_in_another else widest / 2)
    if len(widths) == 2 and widths[1] > _WIDER * order * widths[0]:
        return False
    return 1 < order <= _HIGHEST and room < _BY_CHANCE * low.value and apart <= room


def _is_in_band(line: Effect, band: Effect) -> bool:
    """Return whether a line lies in a narrow band that has no name."""
    known, ends = _frequency(line), _narrow_band(band)
    if known is None or ends is None:
        return False
    return ends[0] - _half(known) <= known.value <= ends[1] + _half(known)


def _narrow_band(effect: Effect) -> tuple[float, float] | None:
    """Return the ends of a range of frequencies that is as narrow as a line; else None."""
    if not {"frequency_low", "frequency_high"} <= set(effect.parameters):
        return None
    low, high = _value(effect, "frequency_low"), _value(effect, "frequency_high")
    return (low, high) if 0 < high - low <= _NARROW * low else None


def _frequency(effect: Effect) -> _Number | None:
    known = effect.parameters.get("frequency")
    return _number(known) if known is not None else None


def line_of(effect: Effect) -> tuple[float, float, float, float] | None:
    """Return frequency, lower, upper and width of a line in Hz; None of what is none."""
    found, ends = _frequency(effect), _narrow_band(effect)
    if found is not None:
        width = _value(effect, "bandwidth") if "bandwidth" in effect.parameters else 0.0
        return found.value, found.lower, found.upper, width
    if ends is None:
        return None
    return 0.5 * (ends[0] + ends[1]), *ends, ends[1] - ends[0]


def _at_once(a: Effect, b: Effect) -> bool:
    """Return whether two events begin or end at one time, or one within the other."""
    return (
        _is_within(a, b)
        or _is_within(b, a)
        or any(
            abs(one.value - other.value) <= max(_AT_ONCE_S, _half(one) + _half(other))
            for one in _edges(a)
            for other in _edges(b)
        )
    )


def _is_within(event: Effect, shock: Effect) -> bool:
    """Return whether an event begins or ends within a shock."""
    if shock.traits.motion != "burst" or "duration" not in shock.parameters:
        return False
    first, last = _edges(shock)
    return any(first.value <= edge.value <= last.value for edge in _edges(event))


def event_times(effect: Effect) -> tuple[float, ...]:
    """Return the times in s at which an effect begins and ends; none where it is no event."""
    return tuple(one.value for one in _edges(effect))


def _edges(effect: Effect) -> list[_Number]:
    """Return the times at which an effect begins and ends; none where it is no event."""
    known = {n: found for n, p in effect.parameters.items() if (found := _number(p)) is not None}
    if "start" in known:
        return [known[name] for name in ("start", "stop") if name in known]
    if "time" not in known:
        return []
    time = known["time"]
    if "duration" not in known:
        return [time]
    late = known["duration"]
    end = (time.value + late.value, time.lower + late.lower, time.upper + late.upper)
    return [time, _Number(*end)]


@dataclass(frozen=True, slots=True)
class _Number:
    """A parameter that is a number, with limits."""

    value: float
    lower: float
    upper: float


def _number(parameter: Parameter) -> _Number | None:
    value = parameter.value
    if isinstance(value, str):
        return None
    low = value if parameter.lower is None else parameter.lower
    high = value if parameter.upper is None else parameter.upper
    return _Number(value, low, high)


def _half(number: _Number) -> float:
    """Return the distance from a number within which another counts as the same."""
    return max(_WIDER * (number.upper - number.lower) / 2, _RELATIVE * abs(number.value))


def _value(effect: Effect, name: str) -> float:
    value = effect.parameters[name].value
    return 0.0 if isinstance(value, str) else value


def _agree(a: Parameter, b: Parameter) -> bool:
    """Return whether two parameters agree: equal names, or numbers whose intervals overlap."""
    one, other = _number(a), _number(b)
    if one is None or other is None:
        return a.value == b.value
    return a.unit == b.unit and abs(one.value - other.value) <= _half(one) + _half(other)


def _alike(a: Parameter, b: Parameter) -> bool:
    """Return whether two numbers are within a factor."""
    one, other = _number(a), _number(b)
    if one is None or other is None:
        return True
    small, large = sorted((abs(one.value), abs(other.value)))
    return large <= _TIMES * small
