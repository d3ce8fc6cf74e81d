"""Lines with labels that name their numbers, and NMEA sentences, whose name stands for a layout.

Consoles and tutorials print one line a sample, or one a sensor::

    Acc[mg]: 12 -3 1001 | Gyr[mdps]: -280 490 -70
    Angular rate [mdps]:  4.38   8.75  -4.38
    Raw: ax=77 ay=-301 az=16679 | gx=14 gy=-182 gz=-122 | t=1162
    Sample: ax=+0.005 ay=-0.019 az=+1.016 g | gx=+0.17 gy=-1.51 gz=-0.75 dps | t=28.67 C

A line counts when it gives all three axes of a sensor. A remark in parentheses is left out. Without
a unit, whole numbers are counts.

A console prints the same sample in several ways: raw, in units, one sensor at a time. The first
dozen lines decide which of them are the stream (`LabelledRows`): lines with both sensors before
lines with one, counts before units, the more frequent kind before the rarer. What is chosen stays.

Sentences as NMEA 0183 has them are a name, values, and a checksum, the XOR of what it is of::

    $VNYMR,+164.618,+022.062,-003.757,-00.3611,...,+00.004000,-00.000843,+00.000141*64

What the values are stands in the manual of who sends them: those of VectorNav are known. A sentence
of another name whose values are all numbers is a row without a header.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass
from functools import reduce
from operator import xor

from allanscope.samples import AXES
from allanscope.wire.rows import ABSENT, Pairing, Triple
from allanscope.wire.text.columns import Column, Columns, column_of
from allanscope.wire.text.units import DIVISORS, Quantity, unit_of_text

__all__ = [
    "LabelledLine",
    "LabelledRow",
    "LabelledRows",
    "Sentence",
    "read_labelled",
    "sentence_in",
]

_SENTENCE = re.compile(rb"[$!](([A-Z][A-Z0-9]{1,9}),([^*$]*))(?:\*([0-9A-Fa-f]{2}|XX))?\s*")
_ACCEL = tuple(Column("accel", "m/s2", AXES.index(axis)) for axis in ("ax", "ay", "az"))
_GYRO = tuple(Column("gyro", "rad/s", AXES.index(axis)) for axis in ("gx", "gy", "gz"))
_ANGLES = _FIELD = (None,) * 3
_QUATERNION = (None,) * 4
_LAYOUTS: dict[bytes, Columns] = {
    b"VNYMR": (*_ANGLES, *_FIELD, *_ACCEL, *_GYRO),
    b"VNQMR": (*_QUATERNION, *_FIELD, *_ACCEL, *_GYRO),
    b"VNMAR": (*_FIELD, *_ACCEL, *_GYRO),
    b"VNIMU": (*_FIELD, *_ACCEL, *_GYRO, Column("temperature", "degc"), None),
    b"VNGYR": _GYRO,
}
"""VectorNav VN-100 user manual, asynchronous messages: magnetic field in Gauss, m/s^2, rad/s."""


@dataclass(frozen=True, slots=True)
class Sentence:
    """One sentence.

    Attributes
    ----------
    name : bytes
    values : bytes
        What lies between name and checksum.
    checksum_ok : bool
        Whether the checksum is right; a sentence without one is taken as it is.
    """

    name: bytes
    values: bytes
    checksum_ok: bool

    @property
    def columns(self) -> Columns | None:
        """What its values are, None for a name that is not known."""
        return _LAYOUTS.get(self.name)


def sentence_in(line: bytes) -> Sentence | None:
    """Return the sentence that a line is, None for any other line.

    >>> sentence_in(b"$VNGYR,-00.001,+00.002,+00.003*4B")
    Sentence(name=b'VNGYR', values=b'-00.001,+00.002,+00.003', checksum_ok=True)
    """
    match = _SENTENCE.fullmatch(line) if line[:1] in b"$!" else None
    if match is None:
        return None
    checksum_ok = match[4] in (None, b"XX") or reduce(xor, match[1]) == int(match[4], 16)
    return Sentence(match[2], match[3], checksum_ok)


LabelledRow = tuple[tuple[float, ...], float]
"""Six values in the units of the text, and the temperature in degC."""
Kind = tuple[str, str, str]
"""Label of a line, unit of its gyroscope, unit of its accelerometer."""

LONGEST_LABELLED = 400
_FLOAT = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_PAIR = re.compile(rf"([A-Za-z]\w{{0,20}})\s*(\[[^\]]{{0,12}}\])?\s*[=:]\s*({_FLOAT})(?![\w.])")
_LIST = re.compile(
    rf"([A-Za-z][A-Za-z ]{{0,30}}?)\s*(\[[^\]]{{0,12}}\])?\s*:\s*"
    rf"({_FLOAT})(?:[\s,;]+({_FLOAT})[\s,;]+({_FLOAT}))?\s*([A-Za-z°/^²\d]{{0,6}})\s*"
)
_UNIT_AT_END = re.compile(r"[\d.]\s*([A-Za-z°][A-Za-z/^²°\d]{0,5})\s*$")
_LABEL = re.compile(r"([A-Za-z][A-Za-z ]{0,30}?)\s*(?:\[[^\]]*\])?\s*:")
_REMARK = re.compile(r"\([^()]*\)")
_SENSOR = re.compile(r"\b(?:(acc\w*)|(gyr\w*|angular rate))\b", re.IGNORECASE)
_WHOLE = re.compile(r"[-+]?\d+")
_ENOUGH = 12


@dataclass(frozen=True, slots=True)
class LabelledLine:
    """What a labelled line says.

    Attributes
    ----------
    gyro, accel : tuple of float or None
        All three axes, in their unit.
    gyro_unit, accel_unit : str
        In the spelling of `DIVISORS`.
    temperature_c : float
        NaN without one.
    counts_c : float
        The temperature in counts of the sensor, which a line of raw values may have; else NaN.
    label : str
        First word of the line: lines of one label are of one kind.
    """

    gyro: Triple | None
    accel: Triple | None
    gyro_unit: str
    accel_unit: str
    temperature_c: float
    counts_c: float
    label: str

    @property
    def kind(self) -> Kind:
        """What lines must have in common to be samples of one stream."""
        return self.label, self.gyro_unit, self.accel_unit


class _LineValues:
    """Values of one line while it is being read."""

    def __init__(self) -> None:
        self.values: dict[int, tuple[str, str]] = {}
        self.temperature: tuple[str, str] | None = None

    def add(self, name: str, number: str, unit: str, sensor: Quantity | None) -> None:
        column = column_of(name)
        if name.lower() in ("x", "y", "z") and sensor is not None:
            self.values[AXES.index(sensor[0] + name.lower())] = number, unit
        elif column is not None and column.axis >= 0:
            self.values[column.axis] = number, unit
        elif name.lower() in ("t", "temp", "temperature"):
            self.temperature = number, unit

    def triple(self, first: int) -> tuple[Triple | None, str]:
        """Return the values of a sensor and their unit, if all three are there and agree."""
        got = [self.values[i] for i in range(first, first + 3) if i in self.values]
        quantity: Quantity = "gyro" if first == 0 else "accel"
        units = {unit for _, unit in got if unit}
        if len(got) < 3 or len(units) > 1 or not units <= set(DIVISORS[quantity]):
            return None, ""
        whole = all(_WHOLE.fullmatch(number) for number, _ in got)
        unit = units.pop() if units else "lsb" if whole else ("dps", "g")[first // 3]
        x, y, z = (float(number) for number, _ in got)
        return (x, y, z), unit


def read_labelled(line: str) -> LabelledLine | None:
    """Return what a line says, None when it does not give all axes of a sensor.

    Parameters
    ----------
    line : str
        Printable text without escape sequences.
    """
    if len(line) > LONGEST_LABELLED or (":" not in line and "=" not in line):
        return None
    line = " ".join(line.split())  # blanks without end cost their square
    found = _LineValues()
    label = _LABEL.search(line)
    for part in _REMARK.sub(" ", line).split("|"):
        _read_part(part, found)
    gyro, gyro_unit = found.triple(0)
    accel, accel_unit = found.triple(3)
    name = label[1].split()[-1].lower() if label else ""
    temperature_c = counts_c = math.nan
    if found.temperature is not None:
        number, unit = found.temperature
        if unit in DIVISORS["temperature"]:
            temperature_c = float(number)
        elif name == "raw":
            counts_c = float(number)
    if gyro is None and accel is None and math.isnan(temperature_c):
        return None
    return LabelledLine(gyro, accel, gyro_unit, accel_unit, temperature_c, counts_c, name)


def _read_part(part: str, found: _LineValues) -> None:
    sensor = _sensor(part)
    if match := _LIST.fullmatch(part.strip()):
        unit = unit_of_text(match[2] or match[6] or "")
        if sensor is not None and match[5] is not None:
            for axis, number in zip("xyz", match.group(3, 4, 5), strict=True):
                found.add(axis, number, unit, sensor)
            return
        if match[5] is None and match[1].strip().lower() in ("temp", "temperature"):
            found.temperature = match[3], unit
            return
    at_end = _UNIT_AT_END.search(part)
    common = unit_of_text(at_end[1]) if at_end else ""
    for name, unit, number in _PAIR.findall(part):
        found.add(name, number, unit_of_text(unit) or common, sensor)


def _sensor(part: str) -> Quantity | None:
    match = _SENSOR.search(part)
    if match is None:
        return None
    return "accel" if match[1] else "gyro"


class LabelledRows:
    """LabelledLine lines to rows.

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
        self._undecided: list[LabelledLine] = []
        self._pairing = Pairing()
        self._temperature_c = math.nan

    def update(self, line: LabelledLine) -> list[LabelledRow]:
        """Take a line and return the rows that can be made now."""
        if self.chosen:
            return self._rows([line])
        self._undecided.append(line)
        with_axes = sum(one.gyro is not None or one.accel is not None for one in self._undecided)
        return self.choose() if with_axes >= _ENOUGH or len(self._undecided) > 10 * _ENOUGH else []

    def choose(self) -> list[LabelledRow]:
        """Choose by the lines so far and return their rows."""
        lines, self._undecided = self._undecided, []
        both = Counter(line.kind for line in lines if line.gyro and line.accel)
        gyro = Counter(line.kind for line in lines if line.gyro)
        accel = Counter(line.kind for line in lines if line.accel)
        kinds = [_best(counted) for counted in ([both] if both else [gyro, accel]) if counted]
        self.chosen = frozenset(kinds)
        for _, gyro_unit, accel_unit in kinds:
            self.units |= {"gyro": gyro_unit} if gyro_unit else {}
            self.units |= {"accel": accel_unit} if accel_unit else {}
        return self._rows(lines) if kinds else []

    def _values(self, line: LabelledLine) -> tuple[float, ...] | None:
        if len(self.chosen) > 1:
            return self._pairing.update(line.gyro, line.accel)
        return (*(line.gyro or ABSENT), *(line.accel or ABSENT))

    def has_chosen_label(self, text: str) -> bool:
        """Return whether a line without values has the label of one that was chosen."""
        label, colon, _ = text.partition(":")
        words = label.lower().split()
        return bool(colon and words) and words[-1] in {kind[0] for kind in self.chosen}

    def _rows(self, lines: list[LabelledLine]) -> list[LabelledRow]:
        rows: list[LabelledRow] = []
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
