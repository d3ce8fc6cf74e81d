"""A finding in a few words: ``line at 12.43 Hz, 0.35 mg``, ``steps and excursions at 45 to 55 s``.

A disturbance that was named is described by what kind it is, where it is and how large; one without
a name in the words in which it was found.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from allanscope.analysis.findings import UNEXPLAINED, Comb, Finding, event_times
from allanscope.explain import Effect, Parameter
from allanscope.labels import kind_name
from allanscope.quantities import (
    DEVIATION,
    LEVEL,
    count,
    duration,
    measured,
    number,
    periods,
    symbols,
)

if TYPE_CHECKING:
    from allanscope.explain import EffectKind

__all__ = [
    "cause_phrase",
    "finding_phrase",
    "finding_sentence",
    "share_text",
    "source_text",
    "with_article",
]

_LEAST_SHARE = 0.01
_SHARES = frozenset({"fraction", "relative", "share"})
_SAME = frozenset({"dps/dps", "g/g"})
"""Units of a share of another axis of the same sensor."""
_FIELD = re.compile(r"\{(\w+)\}")
_FEW_SOURCES = 2
"""Axes that couple into others and are still listed, with their slopes."""
_APART = 2.0
"""Factor between two numbers of one effect on several axes from which they are two."""
_LARGE = 100.0
"""Micro-g from which milli-g are read more easily."""


def finding_sentence(finding: Finding, axes: Sequence[str]) -> str:
    """Return a finding with the axes on which it was seen; `axes` are all that there are."""
    phrase = finding_phrase(finding)
    where = "all axes" if len(finding.axes) == len(axes) > 1 else " ".join(finding.axes)
    return f"{phrase}{',' if ', ' in phrase else ''} on {where}"


def share_text(finding: Finding) -> str:
    """Return which share of the excess over sampling error a finding holds.

    Empty where it is not known or below 1 %: an error of the clock, say, holds all the rest.

    >>> share_text(Finding("step", ("gx",), (), 30.0, share=0.623))
    ' (62 % of the excess)'
    """
    if not finding.share >= _LEAST_SHARE:
        return ""
    return f" ({number(100.0 * finding.share, 2)} % of the excess)"


def source_text(finding: Finding) -> str:
    """Return the source of a line in few words after a comma; empty where it is not known."""
    known = finding.origin
    return f", {known.brief}" if known is not None and known.brief else ""


def cause_phrase(finding: Finding) -> str:
    """Return where a finding comes from and its direction; empty where neither is known."""
    known = [one.words for one in (finding.origin, finding.motion, finding.leak) if one is not None]
    return "; ".join(known)


def finding_phrase(finding: Finding) -> str:
    """Return a finding without its axes: its leading effect over all axes, and what belongs to it.

    Examples
    --------
    >>> from allanscope.analysis.findings import findings_of
    >>> def line(hz, dps):
    ...     return Effect("sinusoid", {"frequency": Parameter(hz, hz, hz, "Hz"),
    ...                                "amplitude": Parameter(dps, dps, dps, "dps")})
    >>> effects = {"gx": [line(50.0, 0.02), line(100.0, 0.002)], "gy": [line(50.0, 0.003)]}
    >>> finding_phrase(findings_of(effects)[0])
    'line at 50 Hz, 3.0 to 20 mdps, with harmonic 2'
    >>> effects["ax"] = [Effect("sinusoid", {"frequency": Parameter(100.0, 100.0, 100.0, "Hz"),
    ...                                      "amplitude": Parameter(1e-3, 1e-3, 1e-3, "g")})]
    >>> finding_phrase(findings_of(effects)[0])
    'line at 50 Hz, 3.0 to 20 mdps, with harmonic 2 (1.0 mg)'
    """
    effects = [one.effect for one in finding.members]
    lead = effects[0]
    if finding.comb is not None:
        return _comb(finding.comb, [one for one in effects if one.kind == lead.kind])
    kinds = Counter(effect.traits for effect in effects)
    events = {kind: times for kind, times in kinds.items() if kind.motion}
    is_repeated = lead.traits.motion and len(effects) > len(finding.axes)
    if is_repeated or len(events) > 1:
        named = [f"{kind_name(kind.kind)}{'s' * (n > 1)}" for kind, n in events.items()]
        text = f"{_listed(named)} at {_times(effects)}"
        others = [kind for kind in kinds if not kind.motion]
    else:
        text = _phrase([one for one in effects if _is_alike(one, lead)])
        others = [kind for kind in kinds if kind is not lead.traits]
    belongs = [with_article(kind) for kind in others]
    if finding.harmonics:
        orders = _listed([str(order) for order in finding.harmonics])
        size = _size_on_other_sensors(effects)
        belongs.append(f"harmonic{'s' * (len(finding.harmonics) > 1)} {orders}{size}")
    if finding.folded:
        belongs[-1] += f" ({_listed([str(order) for order in finding.folded])} folded)"
    belongs += _mixed(finding.mixed)
    return f"{text}, with {_listed(belongs)}" if belongs else text


def with_article(kind: type[EffectKind]) -> str:
    """Return the name of a kind as one says it of one of them: "a line", "unexplained power".

    >>> from allanscope.explain.effects import KINDS
    >>> [with_article(KINDS[kind]) for kind in ("sinusoid", "excursion", "narrowband")]
    ['a line', 'an excursion', 'narrow-band noise']
    """
    name = kind_name(kind.kind)
    if not (kind.is_counted or kind.motion):
        return name
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def _comb(comb: Comb, effects: Sequence[Effect]) -> str:
    """Return which multiples of what the lines are, and how large.

    >>> lines = [Effect("sinusoid", {"amplitude": Parameter(one, one, one, "dps")})
    ...          for one in (0.02, 0.003)]
    >>> _comb(Comb(0.09690, (14, 15, 18, 30)), lines)
    'lines at 14, 15, 18 and 30 times 0.0969 Hz (every 10.3 s), 3.0 to 20 mdps'
    """
    base = number(comb.fundamental_hz, 3)
    period = number(1 / comb.fundamental_hz, 3)
    orders = _listed([str(one) for one in comb.orders])
    size = _sizes(effects[0].traits.sized_by, effects)
    return f"lines at {orders} times {base} Hz (every {period} s), {size}"


def _mixed(mixed: Sequence[str]) -> list[str]:
    """Return the lines that are made of a fundamental f, with equal distances put together.

    >>> _mixed(["f - 1.2 Hz", "f + 1.2 Hz", "fs/2 - f"])
    ['f ± 1.2 Hz', 'fs/2 - f']
    """
    both = {one.replace("f + ", "f - ") for one in mixed if one.startswith("f + ")} & {*mixed}
    paired = (
        one.replace("f - ", "f ± ").replace("f + ", "f ± ")
        if one.replace("f + ", "f - ") in both
        else one
        for one in mixed
    )
    return list(dict.fromkeys(paired))


def _phrase(effects: Sequence[Effect]) -> str:
    """Return what is said of effects of one kind on several axes, the leading one first."""
    lead = effects[0]
    if lead.kind == UNEXPLAINED:
        return _own_words(lead)
    if lead.traits.is_coupling and len(_sources(effects)) > _FEW_SOURCES:
        return "mutual cross-coupling"
    template = lead.traits.phrase
    if not template or not all(_is_known(name, lead) for name in _FIELD.findall(template)):
        return lead.brief or kind_name(lead.kind)
    return _FIELD.sub(lambda field: _filled(field[1], effects), template) + _when(lead)


def _when(effect: Effect) -> str:
    """Return when it is there, where that is a part of the record only, after a comma."""
    spans, share = effect.evidence.get("present"), effect.evidence.get("share_of_time")
    if not spans or share is None:
        return ""
    if len(spans) > 1:
        return f", in {number(100.0 * share, 2)} % of the record"
    first, last = spans[0]
    return f", at {duration(first)} for {duration(last - first)}"


def _sources(effects: Sequence[Effect]) -> set[object]:
    return {effect.parameters["source"].value for effect in effects}


def _own_words(effect: Effect) -> str:
    """Return the words in which something without a name was found, without their figures."""
    words = str(effect.evidence.get("words", "")).partition(";")[0]
    if words:
        return symbols(re.sub(r" \([^()]*\)$", "", words))
    ends = [effect.parameters.get(f"frequency_{end}") for end in ("low", "high")]
    low, high = (one and _frequency(one) for one in ends)
    return f"unexplained power between {_span(low, high, ' and ')}" if low and high else UNEXPLAINED


def _is_alike(effect: Effect, lead: Effect) -> bool:
    """Return whether an effect is of the leading one's kind, and not a harmonic of it."""
    if effect.kind != lead.kind:
        return False
    own, base = (one.parameters.get("frequency") for one in (effect, lead))
    return own is None or base is None or 2 / 3 < float(own.value) / float(base.value) < 1.5


def _size_on_other_sensors(effects: Sequence[Effect]) -> str:
    """Return, in brackets, how large the harmonics are on a sensor that has nothing but these."""
    lead = effects[0]
    name = lead.traits.sized_by
    sized = [effect for effect in effects if name in effect.parameters]
    told = {one.parameters[name].unit for one in sized if _is_alike(one, lead)}
    others = [one for one in sized if one.parameters[name].unit not in told]
    if not others:
        return ""
    return f" ({_sizes(name, others)})"


def _sizes(name: str, effects: Sequence[Effect]) -> str:
    """Return how large effects are, by the parameter of that name."""
    return f"{_filled(name, effects)}{' rms' * (name == 'sigma')}"


def _is_known(name: str, effect: Effect) -> bool:
    return bool(event_times(effect)) if name == "event" else name in effect.parameters


def _filled(name: str, effects: Sequence[Effect]) -> str:
    """Return what stands for a field: one value, or the least and the largest of each unit."""
    if name == "event":
        return _times(effects)
    known = [effect.parameters[name] for effect in effects if name in effect.parameters]
    if name == "frequency":
        # They agree within their intervals: that is why they are one finding.
        most = 3 if "bandwidth" in effects[0].parameters else 4
        return _frequency(known[0], most) + periods(float(known[0].value))
    if any(isinstance(one.value, str) for one in known):
        return _listed(list(dict.fromkeys(str(one.value) for one in known)))
    texts = []
    for unit in dict.fromkeys(one.unit for one in known):
        here = sorted((one for one in known if one.unit == unit), key=_size)
        # What axes share is one value for all of them; where it differs, there are several.
        groups = _apart(here) if name == effects[0].traits.shared_by else [here]
        texts += [_span(_plain(name, group[0]), _plain(name, group[-1])) for group in groups]
    return _listed(texts)


def _apart(parameters: Sequence[Parameter]) -> list[list[Parameter]]:
    """Divide numbers, the least first, where the next is more than twice as large."""
    groups: list[list[Parameter]] = []
    for one in parameters:
        if groups and _size(one) <= _APART * _size(groups[-1][-1]):
            groups[-1].append(one)
        else:
            groups.append([one])
    return groups


def _size(parameter: Parameter) -> float:
    return float(parameter.value)


def _plain(name: str, parameter: Parameter) -> str:
    """Return one number as people say it: in two digits."""
    value = float(parameter.value)
    if name == "count":
        return count(round(value))
    if name in _SHARES or parameter.unit in _SAME:
        return f"{number(100.0 * value, 2)} %"
    if parameter.unit == "s":
        return duration(value)
    if parameter.unit in DEVIATION:
        scale = DEVIATION[parameter.unit]
        if parameter.unit == "g" and abs(value * scale.factor) >= _LARGE:
            scale = LEVEL["g"]
        return f"{number(value * scale.factor, 2)} {symbols(scale.unit)}"
    if parameter.unit in ("", "Hz"):
        return f"{number(value, 2)} {parameter.unit}".rstrip()
    return symbols(measured(value, unit=parameter.unit))


def _frequency(parameter: Parameter, most: int = 4) -> str:
    """Return a frequency in the digits that its interval deserves."""
    value = float(parameter.value)
    low, high = parameter.lower, parameter.upper
    digits = min(3, most)
    if low is not None and high is not None and value > 0:
        digits = most
        while digits > 2 and 0.5 * (high - low) > value * 10.0 ** (1 - digits):
            digits -= 1
    text = number(value, digits)
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return f"{text} {parameter.unit}"


def _times(effects: Sequence[Effect]) -> str:
    times = [time for effect in effects for time in event_times(effect)]
    return _span(duration(min(times)), duration(max(times)))


def _span(low: str, high: str, between: str = " to ") -> str:
    """Return two quantities as a range, with the unit once where it is the same.

    >>> _span("45 s", "55 s"), _span("1 min 10 s", "2 min 10 s"), _span("20 mdps", "20 mdps")
    ('45 to 55 s', '1 min 10 s to 2 min 10 s', '20 mdps')
    """
    if low == high:
        return low
    (first, _, unit), (last, _, other) = low.partition(" "), high.partition(" ")
    if unit == other and " " not in unit:
        return f"{first}{between}{last} {unit}".rstrip()
    return f"{low}{between}{high}"


def _listed(texts: Sequence[str]) -> str:
    """Return texts as a list in a sentence.

    >>> _listed(["2", "3", "5"])
    '2, 3 and 5'
    """
    return " and ".join(filter(None, (", ".join(texts[:-1]), *texts[-1:])))
