"""What rows of a table mean: which axes it has, in which units, at which scale."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from allanscope.parts import PARTS, part_named
from allanscope.samples import AXES, StreamInfo
from allanscope.wire.base import WireSettings
from allanscope.wire.pacing import resolution_of
from allanscope.wire.row import Meaning, Row, Values, nominal_rate
from allanscope.wire.text.units import DIVISORS, Quantity, quantity_named

__all__ = ["TextMeaning"]

_USUAL = {"gyro": "dps", "accel": "g"}
_LONGEST_MS = 150
"""Whole numbers that go up by less are ms (above 7 Hz), by more are us (up to 6.7 kHz)."""
_LARGEST = 1e9
"""In dps or g: no sensor, in whatever unit it was taken for. Its square would spoil every sum."""
_AFTER_RESET = {"gyro": 250.0, "accel": 2.0}
"""Full scales that these parts have until somebody writes to their registers."""


class TextMeaning:
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
        self._said: dict[Quantity, str] = {}
        self._assumed: tuple[str, ...] = ()
        self._time_unit_missing = False
        self._epoch = 0

    @property
    def temperature_lsb_per_c(self) -> float:
        """Counts per degree of the part."""
        return self._part.temperature_lsb_per_c

    def expect(
        self,
        units: Mapping[Quantity, str],
        assumed: tuple[str, ...] = (),
        time_unit_missing: bool = False,
    ) -> None:
        """Take note of the units that the text states, and of what had to be assumed so far."""
        self._said = dict(units)
        self._assumed = assumed
        self._time_unit_missing = time_unit_missing

    def decide(self, rows: list[Row]) -> Meaning | None:
        """Return what rows mean; None when no axis ever has a value."""
        values = np.array([row.values for row in rows], np.float64)
        columns = np.flatnonzero(np.isfinite(values).any(axis=0))
        if len(columns) == 0:
            return None
        remarks = list(self._assumed)
        units = [self._unit(AXES[i], values, remarks) for i in columns]
        self._epoch += 1
        counted = all(unit == "lsb" for unit in units) and _whole(values[:, columns])
        per_second = self._time_per_second(rows, remarks)
        rows = [row._replace(device_s=row.device_s / per_second) for row in rows]
        times = [row.device_s for row in rows]
        timed = bool(np.isfinite(times).any())
        info = StreamInfo(
            axes=tuple(AXES[i] for i in columns),
            scale=tuple(
                self._scale_of_counts(_sensor(AXES[i])) if unit == "lsb" else 1.0
                for i, unit in zip(columns, units, strict=True)
            ),
            nominal_hz=self._settings.rate_hz or nominal_rate(rows),
            rate_claimed=bool(self._settings.rate_hz),
            part=self._settings.part,
            wire="text",
            time_resolution_s=resolution_of(times) if timed else 0.0,
            device_clock=timed,
            epoch=self._epoch,
            truncated=tuple(
                unit == "mg" and _whole(values[:, i])
                for i, unit in zip(columns, units, strict=True)
            ),
        )
        divisors = np.array(
            [DIVISORS[_sensor(AXES[i])][unit] for i, unit in zip(columns, units, strict=True)]
        )
        return Meaning(
            info,
            lambda new: _converted(new[:, columns], divisors, counted),
            needed=tuple(columns.tolist()),
            time_per_second=per_second,
            remarks=tuple(dict.fromkeys(remarks)),
        )

    def _time_per_second(self, rows: list[Row], remarks: list[str]) -> float:
        """Return by what to divide the times of the rows."""
        if not self._time_unit_missing:
            return 1.0
        times = np.array([row.device_s for row in rows])
        steps = np.abs(np.diff(times[np.isfinite(times)]))
        unit = "s"
        if _whole(times) and len(steps):
            unit = "ms" if np.median(steps) < _LONGEST_MS else "us"
        remarks.append(f"the text does not say the unit of its time: taken as {unit}")
        return DIVISORS["time"][unit]

    def _unit(self, axis: str, values: Values, remarks: list[str]) -> str:
        sensor = _sensor(axis)
        unit = self.given.get(sensor) or self._said.get(sensor, "")
        if not unit:
            columns = slice(0, 3) if sensor == "gyro" else slice(3, 6)
            unit = "lsb" if _whole(values[:, columns]) else _USUAL[sensor]
            remarks.append(f"the text does not say the unit of {sensor}: taken as {unit}")
        full_scale = self._settings.gyro_fs if sensor == "gyro" else self._settings.accel_fs
        if unit == "lsb" and full_scale is None:
            name = "dps" if sensor == "gyro" else "g"
            remarks.append(
                f"counts of {sensor} without a full scale: taken as {_AFTER_RESET[sensor]:g} {name}"
            )
        return unit

    def _scale_of_counts(self, sensor: Quantity) -> float:
        if sensor == "gyro":
            return self._part.gyro_scale(self._settings.gyro_fs or _AFTER_RESET["gyro"])
        return self._part.accel_scale(self._settings.accel_fs or _AFTER_RESET["accel"])


def _sensor(axis: str) -> Quantity:
    return "gyro" if axis[0] == "g" else "accel"


def _whole(values: Values) -> bool:
    """Return whether all values that there are are whole numbers."""
    there = values[np.isfinite(values)]
    return bool(len(there)) and bool((there == np.trunc(there)).all())


def _converted(
    values: Values, divisors: NDArray[np.float64], counted: bool
) -> tuple[NDArray[np.int16] | NDArray[np.float64], NDArray[np.bool_]]:
    """Return the samples, and which rows can be such: a digit too many makes no acceleration."""
    if counted:
        clipped = np.clip(np.rint(values), -32768, 32767).astype(np.int16)
        return clipped, np.full(len(values), True)
    samples = np.asarray(values / divisors, np.float64)
    possible = ~(np.abs(samples) > _LARGEST).any(axis=1)
    return samples, np.asarray(possible, np.bool_)
