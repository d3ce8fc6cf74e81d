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

import json
import sys
import tomllib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from allanscope.analysis import Analysis, AxisAnalysis
from allanscope.errors import CheckFailed, InputError
from allanscope.noise import Coefficient
from allanscope.pipeline.analyse_file import analyse_input
from allanscope.pipeline.settings import DeviceSettings
from allanscope.quantities import limit as upper_limit
from allanscope.quantities import number
from allanscope.samples import AXES
from allanscope.sanitize import sanitize

__all__ = [
    "Limits",
    "Verdict",
    "check_against",
    "check_failure",
    "compare",
    "read_limits",
    "to_json",
    "to_junit",
]

NAMES = ("Q", "N", "B", "K", "R")
LARGEST = sys.float_info.max

Limits = dict[str, dict[str, dict[str, float]]]
"""Axis and coefficient to ``min`` and ``max``, in dps, g and s."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """One coefficient against its limit.

    Attributes
    ----------
    axis, coefficient : str
        E.g. ``gx`` and ``N``.
    value, lower, upper : float or None
        What was measured, with its 95 % interval, in `unit`; None where nothing was. Where
        `detected` is false only `upper` is known.
    unit : str
    detected : bool
    minimum, maximum : float or None
        The limits.
    reason : str
        Why it failed; empty when it passed.
    """

    axis: str
    coefficient: str
    value: float | None
    lower: float | None
    upper: float | None
    unit: str
    detected: bool
    minimum: float | None
    maximum: float | None
    reason: str

    @property
    def passed(self) -> bool:
        """Whether the limit is met."""
        return not self.reason

    @property
    def shown(self) -> str:
        """The value as people read it; an upper limit where that is all there is."""
        if self.value is None or self.upper is None:
            return "-"
        text = number(self.value) if self.detected else upper_limit(self.upper)
        return f"{text} {self.unit}"

    @property
    def limit(self) -> str:
        """The limits as people read them."""
        low, high = (None if x is None else number(x) for x in (self.minimum, self.maximum))
        if low is None:
            return f"max {high}"
        return f"min {low}" if high is None else f"{low} to {high}"

    def __str__(self) -> str:
        verdict = "PASS" if self.passed else f"FAIL  {self.reason}"
        return f"{self.axis} {self.coefficient}  {self.shown:<24}  {self.limit:<20}  {verdict}"


def check_against(recording: Path, specification: Path, device: DeviceSettings) -> list[Verdict]:
    """Return a verdict for each limit of a specification.

    Raises
    ------
    InputError
        When the specification or the recording cannot be read.
    """
    limits = read_limits(specification)
    return compare(analyse_input(recording, device, quiet=True), limits)


def compare(analysis: Analysis, limits: Limits) -> list[Verdict]:
    """Return a verdict for each limit, axis by axis."""
    return [
        _verdict_on(analysis, axis, name, bounds)
        for axis in AXES
        for name, bounds in limits.get(axis, {}).items()
    ]


def check_failure(verdicts: list[Verdict]) -> CheckFailed | None:
    """Return the error of a check that missed limits, None when all are met."""
    missed = [v for v in verdicts if not v.passed]
    if not missed:
        return None
    named = ", ".join(f"{v.coefficient} of {v.axis}" for v in missed)
    return CheckFailed(f"{len(missed)} of {len(verdicts)} limits missed: {named}")


def to_json(verdicts: list[Verdict], recording: Path, specification: Path) -> str:
    """Return the verdicts as JSON, schema ``allanscope-check/1``."""
    document = {
        "schema": "allanscope-check/1",
        "recording": str(recording),
        "specification": str(specification),
        "passed": all(v.passed for v in verdicts),
        "verdicts": [{**asdict(v), "verdict": "PASS" if v.passed else "FAIL"} for v in verdicts],
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def to_junit(verdicts: list[Verdict], recording: Path, specification: Path) -> str:
    """Return the verdicts as JUnit XML: a test case for each limit, a class for each axis."""
    failed = str(sum(not v.passed for v in verdicts))
    counts = {"tests": str(len(verdicts)), "failures": failed, "errors": "0", "skipped": "0"}
    suites = ElementTree.Element("testsuites", counts)
    name = sanitize(f"allanscope check {recording} --against {specification}")
    suite = ElementTree.SubElement(suites, "testsuite", {"name": name, **counts})
    for v in verdicts:
        about = {"classname": f"allanscope.{v.axis}", "name": v.coefficient}
        case = ElementTree.SubElement(suite, "testcase", about)
        if not v.passed:
            ElementTree.SubElement(case, "failure", {"message": v.reason}).text = str(v)
        else:
            ElementTree.SubElement(case, "system-out").text = str(v)
    ElementTree.indent(suites, " ")
    text: bytes = ElementTree.tostring(suites, encoding="utf-8", xml_declaration=True)
    return text.decode() + "\n"


def _measured(axis: AxisAnalysis, name: str) -> Coefficient | None:
    """Return a coefficient of an axis as it is measured, with what other axes bring.

    N has it. Where another axis leaks in, the other published coefficients are those without it:
    two axes that hold one signal explain each other that way, down to any noise one likes.
    """
    found, loop = axis.coefficients.get(name), axis.explanation
    if (
        name == "N"
        or loop is None
        or not any("source" in effect.parameters for effect in loop.effects)
    ):
        return found
    before = loop.coefficients_before.get(name)
    if found is None or before is None or before.value <= found.value:
        return found
    return before


def _verdict_on(analysis: Analysis, axis: str, name: str, bounds: dict[str, float]) -> Verdict:
    minimum, maximum = bounds.get("min"), bounds.get("max")
    there = analysis.axes.get(axis)
    found = _measured(there, name) if there is not None else None
    if there is None or there.failure or found is None:
        reason = "the recording is too short to tell"
        if there is None:
            reason = "the recording does not have this axis"
        elif there.failure:
            reason = f"the analysis of this axis failed ({there.failure})"
        return Verdict(axis, name, None, None, None, "", False, minimum, maximum, reason)
    # What was not detected may be as large as its upper limit, or nothing at all: a gate has to
    # assume the worse of the two.
    text = number(found.value) if found.detected else number(found.upper, 2)
    reason = ""
    if maximum is not None and (found.value if found.detected else found.upper) > maximum:
        reason = f"{text} {found.unit} exceeds {number(maximum)}"
        if not found.detected:
            reason = f"not detected; the upper limit {text} {found.unit} exceeds {number(maximum)}"
    elif minimum and (found.value if found.detected else 0.0) < minimum:
        reason = f"{text} {found.unit} is below {number(minimum)}"
        if not found.detected:
            reason = (
                f"not detected, below {text} {found.unit}; at least {number(minimum)} is required"
            )
    return Verdict(
        axis,
        name,
        found.value,
        found.lower,
        found.upper,
        found.unit,
        found.detected,
        minimum,
        maximum,
        reason,
    )


def read_limits(path: Path) -> Limits:
    """Return the limits of a specification: by axis and coefficient, ``min``, ``max`` or both.

    Raises
    ------
    InputError
        When it cannot be read, or holds something else than limits.
    """
    try:
        with path.open("rb") as file:
            tables = tomllib.load(file)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not a TOML file: {error}") from None
    groups = {"gyro": AXES[:3], "accel": AXES[3:]}
    limits: Limits = {axis: {} for axis in AXES}
    # Groups first, so that an axis of its own overrules its group wherever it stands in the file.
    for title, table in sorted(tables.items(), key=lambda item: item[0] not in groups):
        if title not in (*groups, *AXES) or not isinstance(table, dict):
            raise InputError(
                f"{path}: [{title}] is not an axis; use gyro, accel or one of {' '.join(AXES)}"
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
        and all(type(v) in (int, float) and 0 <= v <= LARGEST for v in table.values())
    )
    if not sound:
        raise InputError(
            f"{path}: [{title}] {name} = {entry!r} is not a limit; write e.g. N = 0.004 or "
            "N = { min = 0.001, max = 0.004 }"
        )
    return {key: float(value) for key, value in table.items()}
