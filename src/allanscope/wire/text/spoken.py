"""Which of the labelled lines of a console are the stream, and rows made of them.

A console prints the same sample in several ways: raw, in units, one sensor at a time. The first
dozen lines decide: lines with both sensors before lines with one, counts before units, the more
frequent kind before the rarer. What is chosen stays.
"""

from __future__ import annotations

import math
from collections import Counter

from allanscope.wire.pairing import Pairing
from allanscope.wire.text.labelled import Labelled
from allanscope.wire.text.units import Quantity

__all__ = ["Spoken", "SpokenRow"]

SpokenRow = tuple[tuple[float, ...], float]
"""Six values in the units of the text, and the temperature in degC."""

_ENOUGH = 12
_ABSENT = (math.nan,) * 3
Kind = tuple[str, str, str]


class Spoken:
    """Labelled lines to rows.

    Parameters
    ----------
    temperature_lsb_per_c : float
        To read temperatures in counts.

    Attributes
    ----------
    units : dict
        Units of the lines that were chosen.
    chosen : frozenset of tuple
        The kinds of line that were chosen, empty until then.
    """

    def __init__(self, temperature_lsb_per_c: float) -> None:
        self.units: dict[Quantity, str] = {}
        self.chosen: frozenset[Kind] = frozenset()
        self._per_c = temperature_lsb_per_c
        self._heard: list[Labelled] = []
        self._pairing = Pairing()
        self._temperature_c = math.nan

    def take(self, said: Labelled) -> list[SpokenRow]:
        """Take a line and return the rows that can be made now."""
        if self.chosen:
            return self._rows([said])
        self._heard.append(said)
        with_axes = sum(line.gyro is not None or line.accel is not None for line in self._heard)
        return self.settle() if with_axes >= _ENOUGH or len(self._heard) > 10 * _ENOUGH else []

    def settle(self) -> list[SpokenRow]:
        """Choose by what was heard so far and return the rows of it."""
        heard, self._heard = self._heard, []
        both = Counter(line.kind for line in heard if line.gyro and line.accel)
        gyro = Counter(line.kind for line in heard if line.gyro)
        accel = Counter(line.kind for line in heard if line.accel)
        kinds = [_best(counted) for counted in ([both] if both else [gyro, accel]) if counted]
        self.chosen = frozenset(kinds)
        for _, gyro_unit, accel_unit in kinds:
            self.units |= {"gyro": gyro_unit} if gyro_unit else {}
            self.units |= {"accel": accel_unit} if accel_unit else {}
        return self._rows(heard) if kinds else []

    def _values(self, line: Labelled) -> tuple[float, ...] | None:
        if len(self.chosen) > 1:
            return self._pairing.take(line.gyro, line.accel)
        return (*(line.gyro or _ABSENT), *(line.accel or _ABSENT))

    def begins_like_a_row(self, text: str) -> bool:
        """Return whether a line that says nothing has the label of one that was chosen."""
        label, colon, _ = text.partition(":")
        words = label.lower().split()
        return bool(colon and words) and words[-1] in {kind[0] for kind in self.chosen}

    def _rows(self, lines: list[Labelled]) -> list[SpokenRow]:
        rows: list[SpokenRow] = []
        for line in lines:
            degrees = line.temperature_c
            if line.kind in self.chosen:
                if not math.isnan(line.counts_c):
                    degrees = 25.0 + line.counts_c / self._per_c
                values = self._values(line)
                if values is not None:
                    known = self._temperature_c if math.isnan(degrees) else degrees
                    rows.append((values, known))
                    self._temperature_c = math.nan
            elif line.gyro is None and line.accel is None:
                self._temperature_c = degrees
        return rows


def _best(kinds: Counter[Kind]) -> Kind:
    """Return the kind to take: counts before units, then the most frequent, then the first."""
    return max(kinds, key=lambda kind: ("lsb" in kind[1:], kinds[kind]))
