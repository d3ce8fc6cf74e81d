"""A gate: the coefficients of a recording against the limits of a specification.

A specification is a TOML file with a table for each axis, or ``gyro`` and ``accel`` for all of one
sensor, and the largest value allowed, in dps, g and s::

    [gyro]
    N = 0.004            # dps/sqrt(Hz)
    B = { max = 0.002 }
    [az]
    N = { min = 1e-5, max = 1e-4 }
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from allanscope.analysis.result import Analysis
from allanscope.errors import CheckFailed, InputError
from allanscope.noise.coefficients import Coefficient
from allanscope.pipeline.analyse import analyse_input
from allanscope.pipeline.settings import DeviceSettings
from allanscope.quantities import number
from allanscope.samples import AXES

__all__ = ["check_against", "compare"]

NAMES = ("Q", "N", "B", "K", "R")


def check_against(recording: Path, specification: Path, device: DeviceSettings) -> list[str]:
    """Return a line for each limit that is met.

    Raises
    ------
    CheckFailed
        When one is missed; the message names all that are.
    InputError
        When the specification or the recording cannot be read.
    """
    limits = _read(specification)
    lines, missed = compare(analyse_input(recording, device, quiet=True), limits)
    if missed:
        raise CheckFailed("; ".join(missed))
    return lines


def compare(
    analysis: Analysis, limits: dict[str, dict[str, dict[str, float]]]
) -> tuple[list[str], list[str]]:
    """Return a line for each limit that is met, and one for each that is missed."""
    met: list[str] = []
    missed: list[str] = []
    for axis in AXES:
        failure = analysis.axes[axis].failure if axis in analysis.axes else ""
        if failure and limits.get(axis):
            missed.append(f"{axis}: the analysis of this axis failed ({failure})")
            continue
        for name, bounds in limits.get(axis, {}).items():
            if axis not in analysis.axes:
                missed.append(f"{axis} {name}: the recording does not have this axis")
                continue
            found = analysis.axes[axis].coefficients.get(name)
            good, line = _judge(axis, name, found, bounds)
            (met if good else missed).append(line)
    return met, missed


def _judge(
    axis: str, name: str, found: Coefficient | None, bounds: dict[str, float]
) -> tuple[bool, str]:
    if found is None:
        return False, f"{axis} {name}: the recording is too short to tell"
    # An undetected term is as large as its upper limit allows: that is what a gate has to assume.
    value = found.value if found.detected else found.upper
    sign = "" if found.detected else "below "
    text = f"{axis} {name} is {sign}{number(value)} {found.unit}"
    if value > bounds.get("max", float("inf")):
        return False, f"{text}, more than {number(bounds['max'])}"
    if value < bounds.get("min", 0.0):
        return False, f"{text}, less than {number(bounds['min'])}"
    return True, text


def _read(path: Path) -> dict[str, dict[str, dict[str, float]]]:
    try:
        with path.open("rb") as file:
            tables = tomllib.load(file)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is no TOML file: {error}") from None
    groups = {"gyro": AXES[:3], "accel": AXES[3:]}
    limits: dict[str, dict[str, dict[str, float]]] = {axis: {} for axis in AXES}
    # Groups first, so that an axis of its own overrules its group wherever it stands in the file.
    for title, table in sorted(tables.items(), key=lambda item: item[0] not in groups):
        if title not in (*groups, *AXES) or not isinstance(table, dict):
            raise InputError(
                f"{path}: [{title}] is no axis; use gyro, accel or one of {' '.join(AXES)}"
            )
        for name, entry in table.items():
            for axis in groups.get(title, (title,)):
                limits[axis][name] = _bounds(path, title, name, entry)
    if not any(limits.values()):
        raise InputError(f"{path} sets no limit; write e.g. N = 0.004 below [gyro]")
    return limits


def _bounds(path: Path, title: str, name: str, entry: Any) -> dict[str, float]:
    table = entry if isinstance(entry, dict) else {"max": entry}
    sound = (
        name in NAMES
        and table
        and set(table) <= {"min", "max"}
        and all(type(v) in (int, float) and v >= 0 for v in table.values())
    )
    if not sound:
        raise InputError(
            f"{path}: [{title}] {name} = {entry!r} is no limit; write e.g. N = 0.004 or "
            "N = { min = 0.001, max = 0.004 }"
        )
    return {key: float(value) for key, value in table.items()}
