"""Lines that two recordings share: what they have in common tells the source and the frequency.

A line of the sensor's own clock is seen at the same fraction of the sample rate whatever that is; a
line of true frequency f at f folded about each rate. Two rates that differ, by setting or because
they are two boards, leave one of these hypotheses. Each is held against the lines of the other
recording within the errors of both frequencies and both clocks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from allanscope.analysis.line_families import FOLDS, fold
from allanscope.quantities import TWO_SIDED_95, number

__all__ = ["RecordedLines", "SharedLine", "lines_in_both"]

_AGREE = 3.0
"""Standard errors within which a frequency agrees."""
_SHOWN = 3
_APART_NATS = 3.0
"""Nats by which the hypothesis must be better than the next."""
_CHANCE = 0.05
"""Expected number of agreements by chance, of one line with all of the other recording."""


@dataclass(frozen=True, slots=True)
class RecordedLines:
    """The lines of one recording.

    Attributes
    ----------
    rate_hz, rate_ppm : float
        True sample rate, and its standard error.
    lines : sequence of (frequency, lower, upper)
        In Hz, with 95 % intervals.
    """

    rate_hz: float
    rate_ppm: float
    lines: Sequence[tuple[float, float, float]]


@dataclass(frozen=True, slots=True)
class SharedLine:
    """A line that both recordings have.

    Attributes
    ----------
    seen_hz : (float, float)
        Where each of them has it.
    source : {'internal', 'external', 'unknown'}
        ``unknown`` where more than one hypothesis agrees.
    frequency_hz, lower_hz, upper_hz : float or None
        True frequency of one from outside with its 95 % interval; None where it is not known.
    candidates_hz : tuple of float
        True frequencies that remain.
    margin_nats : float
        Log-likelihood over the next hypothesis.
    by_chance : float
        Expected number of agreements of this line, had none a reason.
    words : str
        In a phrase.
    """

    seen_hz: tuple[float, float]
    source: str
    frequency_hz: float | None
    lower_hz: float | None
    upper_hz: float | None
    candidates_hz: tuple[float, ...]
    margin_nats: float
    by_chance: float
    words: str


def lines_in_both(first: RecordedLines, second: RecordedLines) -> tuple[SharedLine, ...]:
    """Return the lines of the first recording that the second has as well.

    Parameters
    ----------
    first, second : RecordedLines
        At rates that differ: two settings, or two boards.

    Examples
    --------
    >>> slow = RecordedLines(104.0, 5.0, [(46.0, 45.999, 46.001)])
    >>> fast = RecordedLines(208.3, 5.0, [(58.3, 58.299, 58.301)])
    >>> print(lines_in_both(slow, fast)[0].words)
    external, alias of 150 Hz
    """
    found = []
    for line in first.lines:
        matches = [one for other in second.lines for one in _matches(line, other, first, second)]
        if not matches:
            continue
        matches.sort(key=lambda one: one.misfit)
        chance = _by_chance(line, matches[0].turns, first, second)
        if chance <= _CHANCE:
            found.append(_decided(matches, chance, first.rate_hz))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class _Match:
    """A hypothesis that agrees.

    Attributes
    ----------
    seen_hz : (float, float)
        Where the line is seen.
    true : (float, float) or None
        True frequency and its standard error; None where it is of the sensor's clock.
    turns : int
        Multiple of the sample rate about which it is folded.
    misfit : float
        Negative log-likelihood: one that says less exactly where the line is deserves less.
    """

    seen_hz: tuple[float, float]
    true: tuple[float, float] | None
    turns: int
    misfit: float


def _matches(
    line: tuple[float, float, float],
    other: tuple[float, float, float],
    first: RecordedLines,
    second: RecordedLines,
) -> list[_Match]:
    """Return the hypotheses that agree within the errors."""
    seen = line[0], other[0]
    errors = _error(line), _error(other)
    ratio = second.rate_hz / first.rate_hz
    tried: list[tuple[float, float, tuple[float, float] | None, int]] = [
        (line[0] * ratio, math.hypot(errors[1], errors[0] * ratio), None, 0)
    ]
    for true, k in _places(line[0], first.rate_hz):
        # In counts the frequency is exact: the error of the clock is that of all of it.
        own = math.hypot(errors[0], true * 1e-6 * first.rate_ppm)
        there = math.hypot(errors[1], true * 1e-6 * second.rate_ppm)
        tried.append((fold(true, second.rate_hz), math.hypot(own, there), (true, own), k))
    return [
        _Match(seen, true, k, 0.5 * ((other[0] - place) / error) ** 2 + math.log(error))
        for place, error, true, k in tried
        if abs(other[0] - place) < _AGREE * error
    ]


def _places(seen: float, rate_hz: float) -> list[tuple[float, int]]:
    """Return the true frequencies that would be seen there, and the multiple of the rate."""
    both = [(k * rate_hz + sign * seen, k) for k in range(FOLDS + 1) for sign in (1, -1)]
    return sorted(one for one in both if one[0] > 0)


def _error(line: tuple[float, float, float]) -> float:
    return max((line[2] - line[1]) / (2 * TWO_SIDED_95), 1e-7 * line[0])


def _by_chance(
    line: tuple[float, float, float], turns: int, first: RecordedLines, second: RecordedLines
) -> float:
    """Return how many agreements are to be expected of this hypothesis and of simpler ones."""
    ppm = 1e-6 * math.hypot(first.rate_ppm, second.rate_ppm)
    places = [0.0, *(true for true, k in _places(line[0], first.rate_hz) if k <= turns)]
    return sum(
        min(1.0, 4 * _AGREE * math.hypot(_error(line), _error(other), ppm * true) / second.rate_hz)
        for other in second.lines
        for true in places
    )


def _decided(matches: Sequence[_Match], chance: float, rate_hz: float) -> SharedLine:
    best = matches[0]
    rivals = [one for one in matches[1:] if one.true != best.true]
    # What does not agree within the errors is at least as far away as they reach.
    margin = min((one.misfit for one in rivals), default=best.misfit + 0.5 * _AGREE**2)
    margin -= best.misfit
    if rivals and margin < _APART_NATS:
        near = [one for one in matches if one.misfit - best.misfit < _APART_NATS]
        left = tuple(sorted({one.true[0] for one in near if one.true is not None}))
        text = " or ".join([_hz(one) for one in left[:_SHOWN]])
        text += f" or one of {len(left) - _SHOWN} higher" if len(left) > _SHOWN else ""
        if all(one.true is not None for one in near):
            words = f"external, at {text}"
            return SharedLine(best.seen_hz, "external", None, None, None, left, 0.0, chance, words)
        words = f"not determined by these two recordings: the sensor's clock, or {text}"
        return SharedLine(best.seen_hz, "unknown", None, None, None, left, 0.0, chance, words)
    if best.true is None:
        words = "locked to the sensor's clock"
        return SharedLine(best.seen_hz, "internal", None, None, None, (), margin, chance, words)
    true, error = best.true
    words = f"external, {'alias of' if true > rate_hz / 2 else 'at'} {_hz(true)}"
    ends = true - TWO_SIDED_95 * error, true + TWO_SIDED_95 * error
    return SharedLine(best.seen_hz, "external", true, *ends, (true,), margin, chance, words)


def _hz(value: float) -> str:
    text = number(value, 5)
    return (text.rstrip("0").rstrip(".") if "." in text else text) + " Hz"
