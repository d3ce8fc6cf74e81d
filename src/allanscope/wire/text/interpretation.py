"""What rows of a table mean: which axes it has, in which units, at which scale."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from allanscope.parts import OSCILLATOR_TOLERANCE, PARTS, RESET_FULL_SCALES, part_named
from allanscope.samples import AXES, INT16_MAX, INT16_MIN, StreamInfo
from allanscope.wire.base import WireSettings
from allanscope.wire.rows import HELD, Interpretation, Row, Values, nominal_rate
from allanscope.wire.text.table import Table
from allanscope.wire.text.units import (
    DIVISORS,
    LARGEST,
    SMALLEST,
    Quantity,
    accel_comes_first,
    assumed_as,
    gyro_unit,
    quantity_named,
    shows_gravity,
    unit_by_gravity,
)
from allanscope.wire.timestamps import (
    comb_of,
    mean_rate,
    period_of,
    resolution_of,
    rows_come_in_bursts,
    rows_come_unevenly,
)

__all__ = ["TextInterpreter"]

_SHORT = {"time": "t", "temperature": "temp"}
_USUAL = {"gyro": "dps", "accel": "g"}
_CENTURY_S = (946684800.0, 4102444800.0)
"""The years 2000 and 2100, in s since 1970."""
_LONGEST_PERIOD_S = 10.0
"""Mean time between rows that count as one record."""
_LONGEST_MS = 150
"""Whole numbers that go up by less are ms (above 7 Hz), by more are us (up to 6.7 kHz), and by more
than as many thousands ns."""
_DAMAGED = 0.01
"""Share of counts that damage may have put out of range."""
_STATED_RATE = re.compile(
    r"(?:(?i:sampl(?:e|ing)[ _-]?(?:rate|freq\w*)"
    r"|(?:data|output|update)[ _-]?(?:data[ _-]?)?rate)"
    r"|\A\W*[Ff]s)"
    r"[ _]*(?i:[\[(]?hz[\])]?)?\s*[:=,;\s]\s*(\d+(?:\.\d+)?)\s*(?i:(k?)hz)?(?![\w.])"
)
"""A sample rate, as lines before a table say it: `Fs,100`, `Update Rate: 40.0Hz`. `ODR: 104 Hz` is
that of a sensor, whose rows may be read at another."""
_HEADING = 30
"""Lines above a table that may be its heading: more are the talk of a console."""
_FARTHEST = 2.5
"""So many times the longest step between bursts is a gap all the same."""


class _Timing(NamedTuple):
    """What the times of rows are good for.

    Attributes
    ----------
    per_second : float
        How many of their unit make a second; NaN where they are not to be used.
    hz : float
        Rate that they show; 0 when they do not.
    farthest_s : float or None
        Where they come in bursts: a step above which rows are missing all the same.
    """

    per_second: float
    hz: float
    farthest_s: float | None = None


class TextInterpreter:
    """Decides what rows of six values in units of the text mean.

    Parameters
    ----------
    settings : WireSettings
        What the user said; it has the last word on units.

    Attributes
    ----------
    given : dict
        Units that the user gave.
    """

    def __init__(self, settings: WireSettings) -> None:
        self.given: Mapping[Quantity, str] = dict(
            quantity_named(group, unit) for group, unit in settings.units.items()
        )
        self._settings = settings
        self._part = part_named(settings.part) if settings.part else PARTS["LSM6DSM"]
        self._scale_of_counts("gyro")
        self._scale_of_counts("accel")
        self._stated: dict[Quantity, str] = {}
        self._assumed: tuple[str, ...] = ()
        self._table: Table | None = None
        self._by_position = ""
        self._stated_rate: tuple[float, str] = (0.0, "")
        self._lines_above = 0
        self._epoch = 0

    @property
    def temperature_lsb_per_c(self) -> float:
        """Counts per degree of the part."""
        return self._part.temperature_lsb_per_c

    def note(self, line: str) -> None:
        """Take note of a line before the rows, which may state the sample rate."""
        self._lines_above += 1
        found = _STATED_RATE.search(line)
        if self._lines_above > _HEADING:
            self._stated_rate = 0.0, ""
        elif found and float(found[1]):
            self._stated_rate = float(found[1]) * (1e3 if found[2] else 1.0), found[0].strip(" #%/")

    def expect(
        self,
        units: Mapping[Quantity, str],
        assumed: tuple[str, ...] = (),
        table: Table | None = None,
        by_position: str = "",
    ) -> None:
        """Take note of the units that the text states, and of what had to be assumed so far.

        Parameters
        ----------
        units : mapping
            Quantity to its unit.
        assumed : tuple of str
            Remarks.
        table : Table, optional
            The table whose rows are to be understood.
        by_position : str
            Why it is only by their place that its columns are a gyroscope or an accelerometer;
            empty where they have names.
        """
        self._stated = dict(units)
        self._assumed = assumed
        self._table = table
        self._by_position = by_position

    def decide(self, rows: list[Row]) -> Interpretation | None:
        """Return what rows mean; None when no axis ever has a value."""
        values = np.array([row.values for row in rows], np.float64)
        columns = np.flatnonzero(np.isfinite(values).any(axis=0))
        if len(columns) == 0:
            return None
        remarks = list(self._assumed)
        turned = 3 if self._by_position and self._turned(values) else 0
        places = sorted(((i + turned) % len(AXES), i) for i in columns.tolist())
        axes = tuple(AXES[axis] for axis, _ in places)
        columns = np.array([column for _, column in places])
        if self._by_position:
            remarks.append(self._place_remark(turned))
        units = self._units(axes, values[:, columns], remarks)
        self._epoch += 1
        counted = all(unit == "lsb" for unit in units) and _whole(values[:, columns])
        if counted and not _of_16_bits(values[:, columns]):
            remarks.append("counts beyond 16 bits with a sign: taken as they are")
            counted = False
        timing = self._timing(rows, columns, remarks)
        rows = [row._replace(device_s=row.device_s / timing.per_second) for row in rows]
        times = [row.device_s for row in rows]
        timed = bool(np.isfinite(times).any())
        stated_hz = 0.0
        if not (self._settings.rate_hz or timing.hz) and self._stated_rate[0]:
            stated_hz, words = self._stated_rate
            remarks.append(f"no times: the rate is {stated_hz:g} Hz, from {words!r} above the rows")
        info = StreamInfo(
            axes=axes,
            scale=tuple(
                self._scale_of_counts(_sensor(axis)) if unit == "lsb" else 1.0
                for axis, unit in zip(axes, units, strict=True)
            ),
            nominal_hz=self._settings.rate_hz or timing.hz or stated_hz,
            rate_claimed=bool(self._settings.rate_hz or stated_hz),
            part=self._settings.part,
            wire="text",
            tabular=True,
            time_resolution_s=resolution_of(times) if timed else 0.0,
            device_clock=timed,
            epoch=self._epoch,
            truncated=tuple(
                unit == "mg" and _whole(values[:, i])
                for i, unit in zip(columns, units, strict=True)
            ),
        )
        divisors = np.array(
            [DIVISORS[_sensor(axis)][unit] for axis, unit in zip(axes, units, strict=True)]
        )
        return Interpretation(
            info,
            lambda new: _converted(new[:, columns], divisors, counted),
            needed=tuple(columns.tolist()),
            zeros_are_blank=axes[-3:] == AXES[3:] and shows_gravity(values[:, columns[-3:]]),
            time_per_second=timing.per_second,
            farthest_s=timing.farthest_s,
            remarks=tuple(dict.fromkeys(remarks)),
        )

    def _turned(self, values: Values) -> bool:
        """Return whether columns that are a gyroscope by their place hold gravity.

        Three columns alone are a gyroscope where its unit was given.
        """
        six = np.isfinite(values[:, 3:]).any()
        return (six or "gyro" not in self.given) and accel_comes_first(values)

    def _place_remark(self, turned: int) -> str:
        """Return what columns without names were taken for, and by what."""
        assert self._table is not None
        columns = [column for column in self._table.columns if column is not None]
        names = " ".join(
            AXES[(c.axis + turned) % len(AXES)] if c.axis >= 0 else _SHORT[c.quantity]
            for c in columns
        )
        why = ", because gravity is in the first three" if turned else ""
        count = len(self._table.columns)
        return f"{self._by_position}: {count} columns, assumed to be {names}{why}"

    def _timing(self, rows: list[Row], columns: NDArray[np.intp], remarks: list[str]) -> _Timing:
        """Return what the times are good for: a rate that the user gave has the last word."""
        per_second = self._time_per_second(rows, remarks)
        given = self._settings.rate_hz
        if given and _goes_back(rows):
            remarks.append(
                "the times go back from row to row; they are ignored, "
                f"the rate is the given {given:g} Hz"
            )
            return _Timing(math.nan, given)
        scaled = [row._replace(device_s=row.device_s / per_second) for row in rows]
        whole = [row.device_s for row in scaled if np.isfinite(np.take(row.values, columns)).all()]
        mean = mean_rate(whole)
        comb = cache(lambda: comb_of(whole))
        period = period_of(whole, comb)
        uneven = len(whole) > 4 * HELD and rows_come_unevenly(whole)
        uneven = uneven and (period is None or comb() is None)
        if rows_come_in_bursts(whole) or uneven:
            words = f"the times come unevenly or in bursts, {mean:.4g} rows per second on average"
            if given:
                remarks.append(f"{words}; they are ignored, the rate is the given {given:g} Hz")
                return _Timing(math.nan, given)
            remarks.append(f"{words}, which is used as the rate; single lost samples do not show")
            farthest = _FARTHEST * float(np.diff([t for t in whole if math.isfinite(t)]).max())
            return _Timing(per_second, float(f"{mean:.4g}"), farthest)
        # Of few rows of a clock that stands still for several, rows over time says little.
        shown = 1.0 / period if period else mean if len(whole) > 4 * HELD else 0.0
        if given and shown and abs(shown / given - 1.0) > OSCILLATOR_TOLERANCE:
            remarks.append(
                f"the times show {shown:.4g} rows per second, not the given {given:g} Hz; "
                "they are ignored"
            )
            return _Timing(math.nan, given)
        return _Timing(per_second, nominal_rate(scaled))

    def _time_per_second(self, rows: list[Row], remarks: list[str]) -> float:
        """Return by what to divide the times of the rows."""
        if self._table is None or not self._table.time_unit_missing:
            return 1.0
        times = np.array([row.device_s for row in rows])
        steps = np.abs(np.diff(times[np.isfinite(times)]))
        unit = "s"
        if _whole(times) and len(steps) and not _are_dates(times):
            step = float(np.median(steps))
            unit = "ms" if step < _LONGEST_MS else "us" if step < 1e3 * _LONGEST_MS else "ns"
        remarks.append(f"the text gives no unit of time: {unit} assumed")
        return DIVISORS["time"][unit]

    def _units(self, axes: tuple[str, ...], values: Values, remarks: list[str]) -> list[str]:
        """Return the unit of every axis; what is not said goes by the values of its sensor."""
        sensors = [_sensor(axis) for axis in axes]
        units: dict[Quantity, str] = {}
        said: dict[Quantity, list[str]] = {sensor: [] for sensor in sensors}
        for sensor in sorted(said):  # the accelerometer first
            own = values[:, [other == sensor for other in sensors]]
            units[sensor] = self._unit(sensor, own, units.get("accel", ""), said[sensor])
        remarks += [remark for sensor in said for remark in said[sensor]]
        stated = self._units_of_columns()
        return [stated.get(axis, units[s]) for axis, s in zip(axes, sensors, strict=True)]

    def _units_of_columns(self) -> dict[str, str]:
        """Return the units that columns of the table state, one may have another than the next."""
        columns = self._table.columns if self._table is not None else ()
        return {
            AXES[c.axis]: c.unit
            for c in columns
            if c is not None and c.axis >= 0 and c.unit and c.quantity not in self.given
        }

    def _unit(self, sensor: Quantity, values: Values, accel: str, remarks: list[str]) -> str:
        unit = self.given.get(sensor) or self._stated.get(sensor, "")
        if not unit:
            by_gravity = unit_by_gravity(values) if sensor == "accel" else ""
            unit, why = by_gravity or "g", "gravity has that size" if by_gravity else ""
            if not by_gravity and _whole(values):
                unit = "lsb"
            elif sensor == "gyro":
                unit, why = gyro_unit(values, accel)
            words = "counts (lsb)" if unit == "lsb" else _spelt(unit)
            remarks.append(f"the text gives no unit of {sensor}: {assumed_as(words, why)}")
        full_scale = self._settings.gyro_fs if sensor == "gyro" else self._settings.accel_fs
        if unit == "lsb" and full_scale is None:
            assumed = f"{RESET_FULL_SCALES[sensor]:g} {_USUAL[sensor]} assumed"
            remarks.append(f"counts of {sensor} without a full scale: {assumed}")
        return unit

    def _scale_of_counts(self, sensor: Quantity) -> float:
        if sensor == "gyro":
            return self._part.gyro_scale(self._settings.gyro_fs or RESET_FULL_SCALES["gyro"])
        return self._part.accel_scale(self._settings.accel_fs or RESET_FULL_SCALES["accel"])


def _sensor(axis: str) -> Quantity:
    return "gyro" if axis[0] == "g" else "accel"


def _goes_back(rows: list[Row]) -> bool:
    """Return whether the time goes back in a tenth of the rows, as no restart makes it."""
    times = np.array([row.device_s for row in rows])
    return int(np.count_nonzero(np.diff(times[np.isfinite(times)]) < 0.0)) > len(rows) // 10


def _spelt(unit: str) -> str:
    return unit.replace("m/s2", "m/s^2")


def _are_dates(times: Values) -> bool:
    """Return whether times are seconds since 1970, in this century.

    A clock in microseconds passes there half an hour after it began, but by hours a row. Finer
    units of a date go by their steps, as all others.

    >>> _are_dates(np.array([1746835168.0, 1746835168.0, 1746835169.0]))
    True
    >>> _are_dates(np.array([1746835168.0, 1746845168.0]))
    False
    """
    there = times[np.isfinite(times)]
    if not len(there):
        return False
    low, high = float(there.min()), float(there.max())
    is_recent = _CENTURY_S[0] < low and high < _CENTURY_S[1]
    return is_recent and high - low < _LONGEST_PERIOD_S * len(there)


def _whole(values: Values) -> bool:
    """Return whether all values that there are are whole numbers."""
    there = values[np.isfinite(values)]
    return bool(len(there)) and bool((there == np.trunc(there)).all())


def _of_16_bits(values: Values) -> bool:
    """Return whether counts are 16 bits with a sign, but for damage: others have 20, or no sign."""
    there = values[np.isfinite(values)]
    beyond = (there > INT16_MAX) | (there < INT16_MIN)
    return bool(np.mean(beyond) < _DAMAGED)


def _converted(
    values: Values, divisors: NDArray[np.float64], counted: bool
) -> tuple[NDArray[np.int16] | NDArray[np.float64], NDArray[np.bool_]]:
    """Return the samples, and which rows can be such: a digit too many makes no acceleration."""
    if counted:
        clipped = np.clip(np.rint(values), INT16_MIN, INT16_MAX).astype(np.int16)
        return clipped, np.full(len(values), True)
    with np.errstate(over="ignore"):  # what is infinite is impossible as well
        samples = np.asarray(values / divisors, np.float64)
    size = np.abs(samples)
    samples[size < SMALLEST] = 0.0
    return samples, np.asarray(~(size > LARGEST).any(axis=1), np.bool_)
