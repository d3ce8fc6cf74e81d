"""Units that columns of text come in, and what to divide by to get dps, g, s and degC."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Literal

from allanscope.errors import UsageError

__all__ = ["DIVISORS", "Quantity", "quantity_named", "unit_of_text"]

Quantity = Literal["gyro", "accel", "time", "temperature"]

DIVISORS: Mapping[Quantity, Mapping[str, float]] = {
    "gyro": {"dps": 1.0, "deg/s": 1.0, "mdps": 1e3, "rad/s": math.radians(1.0), "lsb": 1.0},
    "accel": {"g": 1.0, "mg": 1e3, "ug": 1e6, "m/s2": 9.80665, "mps2": 9.80665, "lsb": 1.0},
    "time": {"s": 1.0, "sec": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9},
    "temperature": {"degc": 1.0, "c": 1.0},
}
"""For each quantity, how many of a unit make one dps, g, s or degC; `lsb` are counts."""

_WRITTEN = (
    *(("µ", "u"), ("μ", "u"), ("²", "2"), ("°", "deg"), ("⁻", "-"), ("¹", "1")),
    *(("−", "-"), ("·", " "), ("*", " ")),
)
_INVERSE_SECONDS = re.compile(r"[\s.]*s(?:ec)?\s*\^?[({]?\s*-\s*([12])[)}]?")
_OTHER_SPELLINGS = {
    **dict.fromkeys(("rad/sec", "radian/s", "radians/s", "rads", "radps"), "rad/s"),
    **dict.fromkeys(("deg/sec", "degree/s", "degrees/s", "degps"), "deg/s"),
    **dict.fromkeys(("m/s/s", "m/sec2", "ms2"), "m/s2"),
    **dict.fromkeys(("seconds", "second"), "s"),
    **dict.fromkeys(("count", "counts", "raw", "digit", "digits"), "lsb"),
}
"""Units that are often written otherwise, by what is left of them without blanks and signs."""

_GROUPS: Mapping[str, Quantity] = {
    "gyro": "gyro",
    "gyr": "gyro",
    "accel": "accel",
    "acc": "accel",
    "time": "time",
    "t": "time",
    "temperature": "temperature",
    "temp": "temperature",
}


def unit_of_text(text: str) -> str:
    """Return a unit in the spelling of `DIVISORS`, whatever stands in the header.

    The degree sign is often mangled on its way; what is left of it is ignored.

    >>> [unit_of_text(unit) for unit in ("µs", "m/s^2", "°C", "DPS", "m/s²")]
    ['us', 'm/s2', 'degc', 'dps', 'm/s2']
    >>> [unit_of_text(unit) for unit in ("rad s^-1", "m s^-2", "rad/sec", "rads", "m/s/s")]
    ['rad/s', 'm/s2', 'rad/s', 'rad/s', 'm/s2']
    """
    text = text.strip().lower()
    for written, plain in _WRITTEN:
        text = text.replace(written, plain)
    text = _INVERSE_SECONDS.sub(lambda match: "/s" + match[1].replace("1", ""), text)
    plain = re.sub(r"[^a-z0-9/]", "", text)
    return _OTHER_SPELLINGS.get(plain, plain)


def quantity_named(group: str, unit: str) -> tuple[Quantity, str]:
    """Return the quantity and the unit that ``--unit group=unit`` means.

    Raises
    ------
    UsageError
        If either is unknown.
    """
    quantity = _GROUPS.get(group.lower())
    if quantity is None:
        raise UsageError(f"unknown group {group!r}; choose one of {', '.join(DIVISORS)}")
    known = unit_of_text(unit)
    if known not in DIVISORS[quantity]:
        choices = ", ".join(DIVISORS[quantity])
        raise UsageError(f"unknown unit {unit!r} of {quantity}; choose one of {choices}")
    return quantity, known
