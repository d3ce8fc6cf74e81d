"""Units of text: how they are written, and which the values show when nothing is written.

`DIVISORS` says what to divide by to get dps, g, s and degC. Where no unit is given the values
show it: at rest an accelerometer shows gravity, whatever the unit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from allanscope.errors import UsageError
from allanscope.parts import ACCEL_SCALES, GYRO_SCALES
from allanscope.quantities import GRAVITY

__all__ = [
    "DIVISORS",
    "LARGEST",
    "SMALLEST",
    "Quantity",
    "accel_comes_first",
    "assumed_as",
    "gyro_unit",
    "quantity_named",
    "shows_gravity",
    "unit_by_gravity",
    "unit_of_text",
]

Quantity = Literal["gyro", "accel", "time", "temperature"]

DIVISORS: Mapping[Quantity, Mapping[str, float]] = {
    "gyro": {
        **{"dps": 1.0, "deg/s": 1.0, "mdps": 1e3, "deg/h": 3600.0},
        **{"rad/s": math.radians(1.0), "mrad/s": 1e3 * math.radians(1.0), "lsb": 1.0},
    },
    "accel": {
        **{"g": 1.0, "mg": 1e3, "ug": 1e6, "m/s2": GRAVITY, "mps2": GRAVITY, "lsb": 1.0},
        **{"mm/s2": 1e3 * GRAVITY, "cm/s2": 1e2 * GRAVITY, "gal": 1e2 * GRAVITY},
        "mgal": 1e5 * GRAVITY,
    },
    "time": {"s": 1.0, "sec": 1.0, "ms": 1e3, "100us": 1e4, "us": 1e6, "ns": 1e9},
    "temperature": {"degc": 1.0, "c": 1.0},
}
"""For each quantity, how many of a unit make one dps, g, s or degC; `lsb` are counts."""

LARGEST, SMALLEST = 1e9, 1e-50
"""In dps or g. No sensor, in whatever unit it was taken for, reads more than the first, whose
square single precision still holds; less than the second is 0, as its fourth power would be."""

_WRITTEN = (
    *(("µ", "u"), ("μ", "u"), ("²", "2"), ("°", "deg"), ("⁻", "-"), ("¹", "1")),
    *(("−", "-"), ("·", " "), ("*", " ")),
)
_INVERSE_SECONDS = re.compile(r"[\s.]*s(?:ec)?\s*\^?[({]?\s*-\s*([12])[)}]?")
_OTHER_SPELLINGS = {
    **dict.fromkeys(("rad/sec", "radian/s", "radians/s", "rads", "radps"), "rad/s"),
    **dict.fromkeys(("deg/sec", "degree/s", "degrees/s", "degps"), "deg/s"),
    **dict.fromkeys(("deg/hr", "deg/hour", "degree/h", "degrees/hour", "dph"), "deg/h"),
    **dict.fromkeys(("m/s/s", "m/sec2", "ms2"), "m/s2"),
    **{"cm/s/s": "cm/s2", "mm/s/s": "mm/s2"},
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
_LEAST_RADIANS, _LEAST_DPS = 1e-5, 0.003
"""Median distances of neighbouring samples that differ: too small for rad/s, and for dps. A quiet
part of 4 mdps/sqrt(Hz) has 4 mdps at 1 Hz and 40 at 104 Hz; in rad/s there are seldom more than
0.003."""
_GRAVITY = {"m/s2": GRAVITY, "g": 1.0, "mg": 1000.0}
"""Size of gravity in the units that accelerations come in. Whole numbers of size 1 are counts,
and so are those of size 1000 of a single axis."""
_OFF = 0.05
"""Scale and offset errors of these parts at rest: 40 mg of zero-g level, and a tilted part adds."""
_STEADY = 0.02
"""Relative scatter of the norm from row to row below which it may be gravity."""
_GYRO_STEPS = (
    *((full_scale, full_scale / 2**15) for full_scale in (125.0, 250.0, 500.0, 1e3, 2e3, 4e3)),
    *GYRO_SCALES.items(),
)
"""Full scales in dps and what a count of 16 bits is there, as most makers have it and as ST."""
_FEWEST_COUNTS, _MOST_COUNTS = 5, 300
"""So few different counts fit a step by chance, and so large ones any: a bump is left out."""
_OFF_A_COUNT, _OFF_A_STEP = 0.05, 1e-3
"""Digits that were cut off, and steps that makers round: 1/131 dps for 250 dps."""
_COARSEST, _WHOLE = 0.15, 1e-6
"""Last digit in steps from which the digits are the step, and how far off a whole number is one."""


def unit_of_text(text: str) -> str:
    """Return a unit in the spelling of `DIVISORS`, whatever stands in the header.

    The degree sign is often mangled on its way; what is left of it is ignored.

    >>> [unit_of_text(unit) for unit in ("µs", "m/s^2", "°C", "DPS", "m/s²")]
    ['us', 'm/s2', 'degc', 'dps', 'm/s2']
    >>> [unit_of_text(unit) for unit in ("°/h", "deg/hr")]
    ['deg/h', 'deg/h']
    >>> [unit_of_text(unit) for unit in ("rad s^-1", "m s^-2", "rad/sec", "rads", "m/s/s")]
    ['rad/s', 'm/s2', 'rad/s', 'rad/s', 'm/s2']
    >>> [unit_of_text(unit) for unit in ("Gal", "cm/s^2", "cm s^-2")]
    ['gal', 'cm/s2', 'cm/s2']
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


def assumed_as(words: str, why: str) -> str:
    """Return what is said of a unit that is assumed, with the reason where there is one.

    >>> assumed_as("g", "gravity has that size"), assumed_as("dps", "")
    ('g assumed, as gravity has that size', 'dps assumed')
    """
    return f"{words} assumed, as {why}" if why else f"{words} assumed"


def gyro_unit(values: NDArray[Any], accel: str) -> tuple[str, str]:
    """Return the unit to assume of a gyroscope whose text gives none, and why, '' for a mere habit.

    The step of its values tells it where it is that of 16 bits of a usual full scale. Otherwise
    who writes m/s^2 writes SI, as phones, ROS, ArduPilot and Xsens do; others write dps, unless the
    noise would be less than that of any MEMS gyroscope then.

    Parameters
    ----------
    values : ndarray, shape (n, k)
        Some rows of its axes.
    accel : str
        Unit of `DIVISORS` of the accelerometer beside it, empty where there is none.

    Examples
    --------
    >>> counts = np.array([[3, -7, 1], [0, -5, 2], [5, -4, -3], [1, -9, -5]])
    >>> gyro_unit(np.radians(counts * 2000.0 / 2**15), "")
    ('rad/s', 'its step is that of 2000 dps in 16 bits')
    >>> gyro_unit(counts * 0.00875, "m/s2")
    ('dps', 'its step is that of 250 dps in 16 bits')
    >>> gyro_unit(counts * 0.01, "m/s2"), gyro_unit(counts * 0.01, "mg")
    (('rad/s', 'accel is in m/s^2'), ('dps', ''))
    >>> gyro_unit(counts * 1e-4, "")
    ('rad/s', 'no MEMS gyroscope has so little noise in dps')
    """
    for unit in ("dps", "mdps", "rad/s"):
        for full_scale, step in _GYRO_STEPS:
            if _counts(values, step * DIVISORS["gyro"][unit]):
                return unit, f"its step is that of {full_scale:g} dps in 16 bits"
    si = DIVISORS["accel"].get(accel) == GRAVITY
    if si:
        return "rad/s", "accel is in m/s^2"
    steps = np.abs(np.diff(values[np.isfinite(values).all(axis=1)], axis=0))
    if steps.any() and _LEAST_RADIANS < np.median(steps[steps > 0.0]) < _LEAST_DPS:
        return "rad/s", "no MEMS gyroscope has so little noise in dps"
    return "dps", ""


def _counts(values: NDArray[Any], step: float) -> bool:
    """Return whether values differ by whole numbers of a step, and of no larger one."""
    rows = np.asarray(values, np.float64)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) == 0:
        return False
    last_digit = 10.0 ** math.ceil(math.log10(_COARSEST * step))
    with np.errstate(over="ignore", invalid="ignore"):  # a damaged number may be of any size
        if (np.abs(rows / last_digit % 1.0 - 0.5) > 0.5 - _WHOLE).all():
            return False
        counts = (rows - np.sort(rows, axis=0)[len(rows) // 2]) / step
    near = counts[(np.abs(counts) < _MOST_COUNTS).all(axis=1)]
    whole = np.rint(near)
    distinct = np.unique(whole)
    if 2 * len(near) < len(rows) or len(distinct) <= _FEWEST_COUNTS:
        return False
    fit = np.abs(near - whole) <= _OFF_A_COUNT + _OFF_A_STEP * np.abs(whole)
    return bool(fit.all() and np.diff(distinct).min() == 1)


def unit_by_gravity(values: NDArray[Any], *, counts: bool = False) -> str:
    """Return the unit in which the rows of an accelerometer have the size of gravity, '' for none.

    Parameters
    ----------
    values : ndarray, shape (n, k)
        Some rows of its one, two or three axes.
    counts : bool
        Whether whole numbers of a size that a full scale of these parts would have count as well.

    Examples
    --------
    >>> unit_by_gravity(np.array([[0.1, -0.2, 9.79], [0.1, -0.2, 9.80]]))
    'm/s2'
    >>> unit_by_gravity(np.array([[0.0, 0.0, 0.02], [0.0, 0.0, 0.01]]))
    ''
    """
    rows = np.asarray(values, np.float64)
    rows = rows[np.isfinite(rows).all(axis=1)]
    size = _steady_size(_norms(rows))
    if size <= 0.0:
        return ""
    whole, complete = bool((rows == np.trunc(rows)).all()), rows.shape[1] == 3
    for unit, gravity in _GRAVITY.items():
        if abs(size / gravity - 1.0) < _OFF and (not whole or (unit == "mg" and complete)):
            return unit
    if counts and whole and any(abs(size * s - 1.0) < _OFF for s in ACCEL_SCALES.values()):
        return "lsb"
    return ""


def shows_gravity(values: NDArray[Any]) -> bool:
    """Return whether an accelerometer weighs what it rests with, whatever the unit and its scale.

    It then never reads 0 on all three axes: such a row was not read from it, but made by a logger
    that had nothing.

    Parameters
    ----------
    values : ndarray, shape (n, 3)
        Some rows of its three axes; those of zeros do not count.

    Examples
    --------
    >>> shows_gravity(np.array([[0.1, -0.2, 9.79], [0.0, 0.0, 0.0], [0.1, -0.2, 9.80]]))
    True
    >>> shows_gravity(np.array([[0.01, 0.0, 0.02], [0.0, 0.0, 0.0], [-0.01, 0.01, 0.0]]))
    False
    """
    rows = np.asarray(values, np.float64)
    norm = _norms(rows[np.isfinite(rows).all(axis=1) & rows.any(axis=1)])
    return _steady_size(norm) > 0.0


def _norms(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(over="ignore"):  # a damaged number may be of any size
        return np.asarray(np.sqrt((rows**2).sum(axis=1)))


def _steady_size(norm: NDArray[np.float64]) -> float:
    """Return the median of norms that hardly scatter; 0 where they do, or there are none."""
    if len(norm) == 0:
        return 0.0
    size = float(np.median(norm))
    if not np.isfinite(size) or float(np.median(np.abs(norm - size))) > _STEADY * size:
        return 0.0
    return size


def accel_comes_first(values: NDArray[Any]) -> bool:
    """Return whether columns without names are rather an accelerometer than a gyroscope in front.

    Parameters
    ----------
    values : ndarray, shape (n, 6)
        Some rows; NaN in the last three columns where there are only three.

    Examples
    --------
    >>> accel_comes_first(np.array([[0.01, 0.02, 9.81, 0.1, 0.2, 0.3]] * 5))
    True
    >>> accel_comes_first(np.array([[0.1, 0.2, 0.3, 0.01, 0.02, 1.0]] * 5))
    False
    """
    front, behind = values[:, :3], values[:, 3:6]
    if not unit_by_gravity(front, counts=True):
        return False
    return not unit_by_gravity(behind, counts=True)
