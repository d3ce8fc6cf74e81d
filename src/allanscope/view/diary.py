"""What is new since the last result: an effect found, an effect gone, a coefficient known.

A remark is the same one while its words are; its numbers may change with every result (how many
samples were saturated so far), and are only told again when one of them has grown to ten times
what was told. The exact number of the moment is in the result and in the report.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from allanscope.analysis.result import Analysis
from allanscope.analysis.wording import (
    coefficient_text,
    coefficient_unit,
    effect_brief,
    effect_text,
)

__all__ = ["Diary", "Entry", "Level"]

Level = Literal["info", "warn", "error"]
Entry = tuple[Level, str]

_TOLD = ("N", "B", "K")

_NUMBER = re.compile(r"\d+(?: \d{3})*(?:\.\d+)?")
_GROWN = 10.0


@dataclass(slots=True)
class Diary:
    """Remembers what was told, and tells only what changed."""

    _effects: dict[tuple[str, str], str] = field(default_factory=dict)
    _coefficients: set[tuple[str, str]] = field(default_factory=set)
    _remarks: dict[str, list[float]] = field(default_factory=dict)

    def news(self, analysis: Analysis) -> list[Entry]:
        """Return what this result says that the last one did not.

        An effect is the same one while its axis, its kind and its number among effects of that
        kind are the same, so that a frequency that is known better is no news.
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
            *(("warn", f"{axes}found {text}") for axes, text in _together(new)),
            *(("info", f"{axes}no longer found {text}") for axes, text in _together(gone)),
        ]

    def _new_values(self, analysis: Analysis) -> list[Entry]:
        lines: list[Entry] = []
        for name, axis in analysis.axes.items():
            for letter in _TOLD:
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
        """Tell whether to say a remark; if so, remember its numbers."""
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
    """Yield what is said of effects after all axes of which it is said, if it is not the stream."""
    axes: dict[str, list[str]] = {}
    for (axis, _), text in effects.items():
        axes.setdefault(text, []).append(axis)
    for text, names in axes.items():
        of = " ".join(name for name in names if name)
        yield f"{of}: " if of else "", text
