"""Log lines of a run in progress: changes, trends of coefficients, gaps.

`ChangeLog` reports changes since the last result: an effect found, an effect gone, a coefficient
known. A remark is the same one while its words are; its numbers may change with every result (how
many samples were saturated so far), and are reported again only when one of them has grown to
ten times what was reported. The exact number of the moment is in the result and in the report.

`Trends` compares a coefficient with what it was when the run was half as long. `GapThrottle` says
one line where a bad link has hundreds of gaps in a second.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from allanscope.analysis import (
    Analysis,
    coefficient_text,
    coefficient_unit,
    effect_brief,
    effect_text,
)
from allanscope.quantities import MAIN_LETTERS, counted
from allanscope.samples import Gap

__all__ = ["ChangeLog", "Direction", "Entry", "GapThrottle", "Level", "Trends"]

Level = Literal["info", "warn", "error"]
Entry = tuple[Level, str]


_NUMBER = re.compile(r"\d+(?: \d{3})*(?:\.\d+)?")
_GROWN = 10.0

Direction = Literal["up", "down", "settled", ""]

_SHARE = 0.05
"""Values are remembered each time the run has grown by this share."""

_APART_S = 1.0


@dataclass(slots=True)
class ChangeLog:
    """Remembers what was logged, and returns only what changed."""

    _effects: dict[tuple[str, str], str] = field(default_factory=dict)
    _coefficients: set[tuple[str, str]] = field(default_factory=set)
    _remarks: dict[str, list[float]] = field(default_factory=dict)

    def update(self, analysis: Analysis) -> list[Entry]:
        """Return what this result says that the last one did not.

        An effect is the same one while its axis, its kind and its number among effects of that
        kind are the same, so that a frequency that is known better is not logged again.
        """
        return [*self._new_effects(analysis), *self._new_values(analysis), *self._new(analysis)]

    def _new_effects(self, analysis: Analysis) -> list[Entry]:
        found = {("", effect.kind): effect_brief(effect) for effect in analysis.effects}
        for name, axis in analysis.axes.items():
            for effect in axis.explanation.own_effects if axis.explanation else ():
                same = sum(key[0] == name and key[1].startswith(effect.kind) for key in found)
                found[name, f"{effect.kind} {same}"] = effect_text(effect)
        new = {key: text for key, text in found.items() if key not in self._effects}
        gone = {key: text for key, text in self._effects.items() if key not in found}
        self._effects = found
        return [
            *(("warn", f"found{on}: {text}") for on, text in _together(new)),
            *(("info", f"no longer found{on}: {text}") for on, text in _together(gone)),
        ]

    def _new_values(self, analysis: Analysis) -> list[Entry]:
        lines: list[Entry] = []
        for name, axis in analysis.axes.items():
            for letter in MAIN_LETTERS:
                known = axis.coefficients.get(letter)
                if known is None or not known.detected or (name, letter) in self._coefficients:
                    continue
                self._coefficients.add((name, letter))
                text = coefficient_text(axis.unit, letter, known)
                lines.append(
                    ("info", f"{name}: {letter} = {text} {coefficient_unit(axis.unit, letter)}")
                )
        return lines

    def _new(self, analysis: Analysis) -> list[Entry]:
        remarks = [*analysis.assumptions, *analysis.remarks]
        for name, axis in analysis.axes.items():
            remarks += [f"{name}: {remark}" for remark in axis.remarks]
        return [("warn", remark) for remark in remarks if self._is_new(remark)]

    def _is_new(self, remark: str) -> bool:
        """Return whether to say a remark; if so, remember its numbers."""
        words = _NUMBER.sub("#", remark)
        numbers = [float(found.replace(" ", "")) for found in _NUMBER.findall(remark)]
        told = self._remarks.get(words)
        if told is not None and all(
            now < _GROWN * max(then, 1.0) for now, then in zip(numbers, told, strict=True)
        ):
            return False
        self._remarks[words] = numbers
        return True


def _together(effects: Mapping[tuple[str, str], str]) -> Iterator[tuple[str, str]]:
    """Yield the axes of each effect, as `` on gx gy``, and its text; no axes for the stream."""
    axes: dict[str, list[str]] = {}
    for (axis, _), text in effects.items():
        axes.setdefault(text, []).append(axis)
    for text, names in axes.items():
        of = " ".join(name for name in names if name)
        yield f" on {of}" if of else "", text


@dataclass(slots=True)
class Trends:
    """Remembers the coefficients of one run, log-spaced, some hundred values each."""

    _times: list[float] = field(default_factory=list)
    _values: list[dict[tuple[str, str], float]] = field(default_factory=list)

    def update(self, analysis: Analysis) -> None:
        """Remember a result."""
        if self._times and analysis.duration_s < (1.0 + _SHARE) * self._times[-1]:
            return
        self._times.append(analysis.duration_s)
        self._values.append(
            {
                (name, letter): known.value
                for name, axis in analysis.axes.items()
                for letter, known in axis.coefficients.items()
                if known.detected
            }
        )

    def direction(self, analysis: Analysis, axis: str, letter: str) -> Direction:
        """Return where a coefficient went since the run was half as long; empty if unknown.

        It is settled when it stayed within half of its present interval.
        """
        known = analysis.axes[axis].coefficients.get(letter)
        then = bisect_right(self._times, 0.5 * analysis.duration_s) - 1
        if known is None or not known.detected or then < 0:
            return ""
        before = self._values[then].get((axis, letter))
        if before is None:
            return ""
        if abs(known.value - before) <= 0.5 * (known.upper - known.lower):
            return "settled"
        return "up" if known.value > before else "down"


@dataclass(slots=True)
class GapThrottle:
    """Says one line for a gap, and none for those that follow within a second.

    Examples
    --------
    >>> throttle = GapThrottle()
    >>> throttle.update(Gap("link", 27), 10.0)
    'gap (link): 27 samples lost'
    >>> throttle.update(Gap("link", 54), 10.1)
    >>> throttle.update(Gap("disconnected", None), 20.0)
    'gap (disconnected): length unknown; 1 more since the last'
    """

    _last_s: float | None = None
    _untold: int = 0

    def update(self, gap: Gap, now_s: float) -> str | None:
        """Return what to say about a gap at time `now_s`, None to say nothing."""
        if self._last_s is not None and now_s - self._last_s < _APART_S:
            self._untold += 1
            return None
        lost = "length unknown" if gap.lost is None else f"{counted(gap.lost, 'sample')} lost"
        more = f"; {self._untold} more since the last" if self._untold else ""
        self._last_s, self._untold = now_s, 0
        return f"gap ({gap.reason}): {lost}{more}"
