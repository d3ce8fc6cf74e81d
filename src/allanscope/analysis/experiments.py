"""The next measurement: one action that would decide what a record cannot, and its evidence.

The log-likelihood by which two rival models of a signal differ grows in proportion to the time for
which it is seen. So what was gained so far tells how long an experiment must last, and what
evidence is to be expected of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from allanscope.analysis.line_families import fold
from allanscope.labels import kind_name
from allanscope.quantities import (
    COEFFICIENTS,
    LETTERS,
    counted,
    duration,
    measured,
    number,
    rough,
    symbols,
)
from allanscope.samples import unit_of

if TYPE_CHECKING:
    from allanscope.analysis.findings import Finding
    from allanscope.analysis.result import Analysis
    from allanscope.explain import Effect

__all__ = ["Experiment", "Measurement", "another_rate", "measurements", "next_experiments"]

SETTLED_NATS = 10.0
"""Evidence after which a question counts as settled: odds of 20 000 to 1."""
_SHORTEST_S = 600.0
_APART = 4.0
"""Places of a line that are fewer resolutions apart than this are one."""
_SHOWN = 3
_KNOWN = 0.2
"""Relative error of a coefficient that counts as known."""
_WARMING = 5.0
"""Time constants after which a warm-up is over."""
_TURN_S, _TURN_DPS, _TILT_G = 60.0, 30.0, 0.5
"""A board that is turned by hand to and fro: how long, and the rms that its axes then show."""
_LEAST_MARGIN = 1.0
"""Nats by which two fitted processes are taken to differ where they differ by less."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """An action, and what it would show.

    Attributes
    ----------
    question : str
        What is open.
    action : str
        What to do, in the imperative.
    expectation : str
        What is to be seen by each of the rivals.
    duration_s : float
        How long it takes; where the record is to be continued, with what there is.
    gain_nats : float
        Log-likelihood that is to be expected between the rivals, of which one is true.
    rate_hz : float or None
        Sample rate of it, where it is another.
    is_of_noise : bool
        Whether the question is a coefficient.
    """

    question: str
    action: str
    expectation: str
    duration_s: float
    gain_nats: float
    rate_hz: float | None = None
    is_of_noise: bool = False

    @property
    def words(self) -> str:
        """Action and outcome in a phrase."""
        return f"{self.action}: {self.outcome}"

    @property
    def outcome(self) -> str:
        """What is to be seen, and how much evidence that is."""
        return f"{self.expectation}; expected log-likelihood gain {nats(self.gain_nats)}"


def nats(gain: float) -> str:
    """Return a log-likelihood gain (nats) in two digits.

    >>> nats(123.4), nats(2.34e4)
    ('120', 'above 1000')
    """
    return "above 1000" if gain > 1000.0 else number(gain, 2)


def another_rate(
    seen_hz: float,
    rate_hz: float,
    candidates_hz: Sequence[float],
    offered_hz: Sequence[float],
    nats_per_s: float,
    *,
    width_hz: float = 0.0,
    or_internal: bool = True,
) -> Experiment | None:
    """Return at which rate a line is seen elsewhere by each of its possible true frequencies.

    Parameters
    ----------
    seen_hz, rate_hz : float
        Where it is seen, and the true sample rate.
    candidates_hz : sequence of float
        True frequencies that remain, the lowest first.
    offered_hz : sequence of float
        Nominal rates that the part offers; empty where they are not known.
    nats_per_s : float
        Log-likelihood that the line gains in a second.
    width_hz : float
        Bandwidth within which it drifts.
    or_internal : bool
        Whether it may be of the sensor's own clock: then it keeps its fraction of the rate.

    Returns
    -------
    Experiment or None
        None where no rate moves one of the candidates away from the others.

    Examples
    --------
    >>> found = another_rate(46.0, 104.0, (46.0, 58.0, 150.0), (52.0, 104.0, 208.0, 416.0), 0.1)
    >>> print(found.words)  # doctest: +NORMALIZE_WHITESPACE
    record 10 min at 416 Hz: seen at 184 Hz if locked to the sensor's clock, at 46 Hz if its
    true frequency is 46 Hz, at 58 Hz if 58 Hz, at 150 Hz if 150 Hz; expected log-likelihood gain 60
    """
    near = min(offered_hz, key=lambda one: abs(one / rate_hz - 1), default=rate_hz)
    if abs(near / rate_hz - 1) > 0.1:
        near, offered_hz = rate_hz, ()
    # At a lower rate the low-pass of the part would take the line away.
    nominal = [one for one in offered_hz if one > near] or [2 * near, 4 * near]
    if nats_per_s <= 0:
        return None
    lasting_s = max(_SHORTEST_S, SETTLED_NATS / nats_per_s)
    resolution = max(_APART / lasting_s, width_hz)
    best: tuple[int, float, list[float]] | None = None
    for asked in sorted(nominal):
        rate = asked * rate_hz / near
        places = [seen_hz / rate_hz * rate] if or_internal else []
        places += [fold(one, rate) for one in candidates_hz]
        apart = _distinct(places, resolution)
        if apart > 1 and (best is None or apart > best[0]):
            best = apart, asked, places
    if best is None:
        return None
    _, asked, places = best
    parts = [f"seen at {_hz(places[0])} if locked to the sensor's clock"] if or_internal else []
    rest = places[or_internal:]
    parts += [
        f"at {_hz(place)} if {'' if i else 'its true frequency is '}{_hz(true)}"
        for i, (true, place) in enumerate(zip(candidates_hz[:_SHOWN], rest, strict=False))
    ]
    text = ", ".join(parts)
    return Experiment(
        question=(
            "where the line at {} comes from"
            if or_internal
            else "the true frequency of the line at {}"
        ).format(_hz(seen_hz)),
        action=f"record {duration(lasting_s)} at {number(asked, 3).removesuffix('.0')} Hz",
        expectation=text if or_internal else f"seen {text}",
        duration_s=lasting_s,
        gain_nats=nats_per_s * lasting_s,
        rate_hz=asked,
    )


def _distinct(places: Sequence[float], resolution: float) -> int:
    """Return how many places can be told apart."""
    ordered = sorted(places)
    return 1 + sum(b - a > resolution for a, b in pairwise(ordered)) if ordered else 0


def _hz(value: float) -> str:
    text = number(value, 4 if value < 1000 else max(4, math.ceil(math.log10(value))))
    return (text.rstrip("0").rstrip(".") if "." in text else text) + " Hz"


def next_experiments(analysis: Analysis) -> tuple[Experiment, ...]:
    """Return the measurements that would decide what a result leaves open.

    That which settles most for its time comes first. Open are a coefficient that was not detected,
    an effect of which another kind would do as well or that happened once, a line without a source,
    and a coupling without a direction.
    """
    asked = [_of_finding(finding, analysis) for finding in analysis.findings]
    found = [one for decided in asked for one in decided]
    rest = [one for one, decided in zip(analysis.findings, asked, strict=True) if not decided]
    once = [one for one in rest if _is_one_motion(one.members[0].effect)]
    noise = [_of_coefficient(letter, analysis) for letter in LETTERS]
    known = [*found, _beside(once, analysis), *noise]
    return tuple(sorted(filter(None, known), key=_worth, reverse=True))


@dataclass(frozen=True, slots=True)
class Measurement:
    """An action, and all that it decides, the most worthwhile first."""

    action: str
    decided: tuple[Experiment, ...]

    @property
    def decides(self) -> str:
        """What it decides and what is to be seen, in a phrase."""
        first, *others = self.decided
        text = f"decides {first.question}: {first.outcome}"
        return f"{text}; also {', '.join(one.question for one in others)}" if others else text


def measurements(experiments: Iterable[Experiment]) -> list[Measurement]:
    """Return each action with all that it decides; the most evidence for its time comes first.

    Examples
    --------
    >>> line = Experiment("the source of a line", "record 10 min at 833 Hz", "", 600.0, 150.0)
    >>> tilt = Experiment("the direction of a coupling", "tilt the board", "", 60.0, 420.0)
    >>> [(one.action, len(one.decided)) for one in measurements([line, line, tilt])]
    [('tilt the board', 1), ('record 10 min at 833 Hz', 2)]
    """
    by_action: dict[str, list[Experiment]] = {}
    for one in experiments:
        by_action.setdefault(one.action, []).append(one)
    ordered = sorted(by_action.items(), key=lambda kv: sum(map(_worth, kv[1])), reverse=True)
    return [Measurement(action, tuple(decided)) for action, decided in ordered]


def _worth(one: Experiment) -> float:
    """Return evidence per second; more than settles the question is worth nothing."""
    return min(one.gain_nats, SETTLED_NATS) / max(one.duration_s, 1.0)


def _of_coefficient(letter: str, analysis: Analysis) -> Experiment | None:
    """Return for how long to record until a coefficient of all axes is known, or excluded."""
    late = {
        name: (axis.unit, known)
        for name, axis in analysis.axes.items()
        if (known := axis.coefficients.get(letter)) is not None
        and known.wait_s is not None
        and not known.detected
        and known.upper > 0
    }
    if not late:
        return None
    sizes: dict[str, list[float]] = {}
    for unit, known in late.values():
        sizes.setdefault(unit, []).append(math.sqrt(known.value * known.upper))
    spans = []
    for unit, here in sizes.items():
        reading = COEFFICIENTS[unit, letter][0]
        ends = dict.fromkeys(number(reading.factor * x, 2) for x in (min(here), max(here)))
        spans.append(f"{' to '.join(ends)} {symbols(reading.unit)}")
    total_s = analysis.duration_s + max(known.wait_s or 0.0 for _, known in late.values())
    return Experiment(
        question=f"{letter} of {_named(late, analysis)}, not detected",
        action=_record_on(total_s, analysis.duration_s),
        expectation=f"{letter} of {' and '.join(spans)} detected, or a limit below it",
        duration_s=total_s,
        # A power that is known to 40 % is 1 / 0.4 standard errors from none.
        gain_nats=0.5 / (2 * _KNOWN) ** 2,
        is_of_noise=True,
    )


def _record_on(total_s: float, length_s: float) -> str:
    """Return for how much longer to record, and how long that is in all."""
    if total_s <= length_s:
        return f"record again for {duration(length_s)}"
    return f"record about {rough(total_s - length_s)} longer, {rough(total_s)} in all"


def _of_finding(finding: Finding, analysis: Analysis) -> list[Experiment]:
    """Return the measurement that would decide what a finding leaves open."""
    if finding.origin is not None and finding.origin.experiment is not None:
        return [finding.origin.experiment]
    lead = finding.members[0]
    effect, where = lead.effect, _named(finding.axes, analysis)
    if effect.traits.is_coupling and finding.leak is None and len(finding.members) > 1:
        return [_turned(effect, lead.axis, analysis)]
    gain = _gain(effect)
    if not gain > 0 or not (effect.equivalent or _is_once(effect)):
        return []
    names = [kind_name(one) for one in (effect.kind, *effect.equivalent)]
    question = f"between {' and '.join(names)} on {where}"
    if not effect.equivalent:
        question = f"whether the {names[0]} on {where}, seen once, is external"
    if any(one.is_thermal for one in effect.rivals):
        return [_warmed(question, effect, gain, analysis.duration_s)]
    if effect.equivalent:
        return [_longer(question, effect, gain, analysis.duration_s)]
    return []


def _gain(effect: Effect) -> float:
    return effect.evidence.get("gain_nats") or 0.0


def _is_once(effect: Effect) -> bool:
    return effect.evidence.get("replicated") == "not replicated"


def _named(names: Iterable[str], analysis: Analysis) -> str:
    names = list(names)
    return "all axes" if len(names) == len(analysis.axes) > 1 else " ".join(names)


def _is_one_motion(effect: Effect) -> bool:
    """Return whether it happened once and may be motion."""
    return bool(effect.traits.motion) and _is_once(effect) and _gain(effect) > 0


def _beside(once: Sequence[Finding], analysis: Analysis) -> Experiment | None:
    """Return what a second board tells: it sees at the same moment what comes from outside."""
    if not once:
        return None
    effect = once[0].members[0].effect
    named = f"the {kind_name(effect.kind)} on {_named(once[0].axes, analysis)}"
    others = len(once) - 1
    more = f" and {counted(others, 'other finding')}" if others else ""
    return Experiment(
        f"whether {named}{more}, seen once, {'are' if others else 'is'} external",
        f"record together with a second board for {duration(analysis.duration_s)}",
        "on both boards at once if external, on one if internal",
        analysis.duration_s,
        max(_gain(one.members[0].effect) for one in once),
    )


def _turned(effect: Effect, axis: str, analysis: Analysis) -> Experiment:
    """Return what a turn of the board tells: only the axis that leaks takes the other along."""
    source = str(effect.parameters["source"].value)
    slope = float(effect.parameters["slope"].value)
    one = analysis.axes[axis]
    noise = one.coefficients["N"].value if "N" in one.coefficients else 0.0
    is_turn = unit_of(source) == "dps"
    rms = _TURN_DPS if is_turn else _TILT_G
    gain = 0.5 * (slope * rms / noise) ** 2 * _TURN_S / 2 if noise > 0 else SETTLED_NATS
    how = f"{'turn the board about' if is_turn else 'tilt the board along'} its {source[1]} axis"
    share = f"{one.unit}/{unit_of(source)}"
    follows = (
        f"{number(100 * slope, 2)} %"
        if one.unit == unit_of(source)
        else measured(slope, unit=share)
    )
    return Experiment(
        f"which of {source} and {axis} couples into the other",
        f"{how} by hand, back and forth, for {duration(_TURN_S)}",
        f"{axis} follows {source} with {symbols(follows)} if {source} is the source",
        _TURN_S,
        gain,
    )


def _warmed(question: str, effect: Effect, gain: float, length_s: float) -> Experiment:
    """Return what a second warm-up tells: the same signal again, or none.

    Both rivals explain one signal of a known log-likelihood. In a second record where only one of
    them predicts it, that is the evidence.
    """
    known = effect.parameters.get("time_constant")
    lasting_s = length_s if known is None else min(_WARMING * float(known.value), length_s)
    rivals: Mapping[str, float] = effect.evidence.get("rivals") or {}
    expected = min([gain, *rivals.values()])
    return Experiment(
        question,
        f"let it cool, switch it on again and record for {duration(lasting_s)}",
        "the same change again if it is a warm-up",
        lasting_s,
        expected,
    )


def _longer(question: str, effect: Effect, gain: float, length_s: float) -> Experiment:
    """Return for how long to record until two processes differ by enough.

    The log-likelihood ratio of two processes grows in proportion to the time. A line that keeps its
    frequency stays in one bin while the bins become narrower, noise in a band does not: after three
    times the record all but a third of the gain is between them.
    """
    rivals: Mapping[str, float] = effect.evidence.get("rivals") or {}
    if all(one.is_line for one in effect.rivals):
        return Experiment(
            question,
            _record_on(3 * length_s, length_s),
            "one bin of the spectrum if it is a line, several if it is noise in a band",
            3 * length_s,
            gain * 2,
        )
    margin = max([_LEAST_MARGIN, *(abs(gain - one) for one in rivals.values())])
    lasting_s = length_s * max(1.0, SETTLED_NATS / margin)
    return Experiment(
        question,
        _record_on(lasting_s, length_s),
        "one of them is rejected",
        lasting_s,
        margin * lasting_s / length_s,
    )
