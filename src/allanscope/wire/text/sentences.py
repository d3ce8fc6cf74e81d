"""Sentences as NMEA 0183 has them: a name, values, and a checksum that is the XOR of what it is of.

::

    $VNYMR,+164.618,+022.062,-003.757,-00.3611,...,+00.004000,-00.000843,+00.000141*64

What the values are stands in the manual of who sends them: those of VectorNav are known. A sentence
of another name whose values are all numbers is a row without a header.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import reduce
from operator import xor

from allanscope.samples import AXES
from allanscope.wire.text.columns import Column, Columns

__all__ = ["Sentence", "sentence_in"]

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
    sound : bool
        Whether the checksum is right; a sentence without one is taken as it is.
    """

    name: bytes
    values: bytes
    sound: bool

    @property
    def columns(self) -> Columns | None:
        """What its values are, None for a name that is not known."""
        return _LAYOUTS.get(self.name)


def sentence_in(line: bytes) -> Sentence | None:
    """Return the sentence that a line is, None for any other line.

    >>> sentence_in(b"$VNGYR,-00.001,+00.002,+00.003*4B")
    Sentence(name=b'VNGYR', values=b'-00.001,+00.002,+00.003', sound=True)
    """
    match = _SENTENCE.fullmatch(line) if line[:1] in b"$!" else None
    if match is None:
        return None
    sound = match[4] in (None, b"XX") or reduce(xor, match[1]) == int(match[4], 16)
    return Sentence(match[2], match[3], sound)
