"""A curve against another one: an earlier session, or a mask over averaging time.

Two estimates of one variance with e1 and e2 equivalent degrees of freedom have a ratio that is
distributed as F(e1, e2); against a mask, which is known exactly, the estimate alone scatters, as
chi-square. An axis is higher where its ratio is improbable by chance; neighbouring averaging times
repeat each other, so that as many are tried as there are octaves.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from allanscope.allan import Deviation
from allanscope.errors import InputError
from allanscope.quantities import duration, number
from allanscope.samples import AXES

__all__ = ["Comparison", "ReferenceCurve", "compare_curve", "read_reference"]

_FALSE_ALARMS = 0.01
"""Probability that an axis of equal noise is called higher."""

_KIND = "oadev"
_GROUPS = {"gyro": AXES[:3], "accel": AXES[3:]}
_MOST_BYTES = 64 << 20


@dataclass(frozen=True, slots=True)
class ReferenceCurve:
    """What a curve is compared with.

    Attributes
    ----------
    name : str
        Folder or file it came from.
    tau : ndarray, shape (k,)
        Averaging times in s, ascending.
    deviation : ndarray, shape (k,)
        In dps or g.
    edf : ndarray, shape (k,), or None
        Equivalent degrees of freedom; None for a mask, which has no error.
    """

    name: str
    tau: NDArray[np.float64]
    deviation: NDArray[np.float64]
    edf: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class Comparison:
    """Whether a curve is higher than its reference.

    Attributes
    ----------
    reference : ReferenceCurve
    tau : (float, float)
        Lowest and highest averaging time in s that both have.
    higher : (float, float) or None
        Lowest and highest averaging time at which the curve is higher beyond chance.
    ratio : float
        Largest ratio of the deviations there; of all where nothing is higher.
    """

    reference: ReferenceCurve
    tau: tuple[float, float]
    higher: tuple[float, float] | None
    ratio: float

    @property
    def passed(self) -> bool:
        """Whether the curve is nowhere higher."""
        return self.higher is None

    @property
    def span(self) -> str:
        """Averaging times at which it is higher; of a curve that passes, those compared."""
        first, last = (duration(tau) for tau in self.higher or self.tau)
        return first if first == last else f"{first} to {last}"

    @property
    def words(self) -> str:
        """One phrase on it, without the name of the axis."""
        if self.higher is None:
            return f"PASS: not higher at τ = {self.span}"
        return f"FAIL: up to {number(self.ratio)} times higher at τ = {self.span}"

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in the JSON."""
        return {
            "reference": self.reference.name,
            "passed": self.passed,
            "tau": list(self.tau),
            "higher": list(self.higher) if self.higher else None,
            "ratio": self.ratio,
        }


def compare_curve(curve: Deviation, reference: ReferenceCurve) -> Comparison | None:
    """Compare the trusted part of a curve with a reference; None where they have no tau in common.

    Examples
    --------
    >>> import allanscope
    >>> rng = np.random.default_rng(1)
    >>> curve = allanscope.deviation(rng.normal(size=10_000), 100.0, "oadev")
    >>> mask = ReferenceCurve("mask.csv", np.array([0.01, 10.0]), np.array([0.9, 0.0285]))
    >>> compare_curve(curve, mask).words
    'FAIL: up to 1.11 times higher at τ = 0.010 s to 0.16 s'
    """
    both = (
        curve.trusted
        & (curve.tau >= reference.tau[0] * (1.0 - 1e-9))
        & (curve.tau <= reference.tau[-1] * (1.0 + 1e-9))
    )
    if not both.any():
        return None
    tau, at = curve.tau[both], np.log(reference.tau)
    expected = np.exp(np.interp(np.log(tau), at, np.log(reference.deviation)))
    ratio = curve.deviation[both] / expected
    edf = curve.edf[both]
    if reference.edf is None:
        chance = special.chdtrc(edf, edf * ratio**2)
    else:
        theirs = np.exp(np.interp(np.log(tau), at, np.log(reference.edf)))
        chance = special.fdtrc(edf, theirs, ratio**2)
    octaves = 1.0 + math.log2(tau[-1] / tau[0])
    higher = chance * octaves < _FALSE_ALARMS
    span = tau[higher]
    return Comparison(
        reference,
        (float(tau[0]), float(tau[-1])),
        (float(span[0]), float(span[-1])) if len(span) else None,
        float(np.max(ratio[higher] if len(span) else ratio)),
    )


def read_reference(path: Path) -> dict[str, ReferenceCurve]:
    """Return the curve of each axis of an earlier session, or of a mask.

    Parameters
    ----------
    path : Path
        Folder of a session, its ``result.json``, or a CSV file with the columns ``tau`` in s and,
        in dps and g, any of ``gyro``, ``accel``, ``gx`` ... ``az``.

    Raises
    ------
    InputError
        When there is no such file, or no curve in it.
    """
    file = path / "result.json" if path.is_dir() else path
    try:
        if file.stat().st_size > _MOST_BYTES:
            raise InputError(f"{file} is too large for a result or a mask")
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is not text"
        raise InputError(f"cannot compare with {file}: {why}") from None
    name = (path if path.is_dir() else file).resolve().name
    try:
        found = _of_result(text, name) if text.lstrip()[:1] == "{" else _of_mask(text, name)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise InputError(f"cannot compare with {file}: {error}") from None
    if not found:
        raise InputError(f"cannot compare with {file}: it has no curve")
    return found


def _of_result(text: str, name: str) -> dict[str, ReferenceCurve]:
    axes = json.loads(text).get("axes", {})
    found = {}
    for axis in AXES:
        curve = axes.get(axis, {}).get("curves", {}).get(_KIND)
        if curve is None:
            continue
        columns = [np.asarray(curve[key], np.float64) for key in ("tau", "deviation", "edf")]
        trusted = np.asarray(curve["trusted"], bool)
        if trusted.any():
            found[axis] = _checked(name, *(column[trusted] for column in columns))
    return found


def _of_mask(text: str, name: str) -> dict[str, ReferenceCurve]:
    rows = list(csv.reader(line for line in text.splitlines() if line.strip()))
    head = [cell.strip().lower() for cell in rows[0]] if rows else []
    unknown = set(head) - {"tau", *_GROUPS, *AXES}
    if "tau" not in head or unknown:
        raise ValueError("a mask is a CSV file with the columns tau and gyro, accel, gx ... az")
    if any(len(row) != len(head) for row in rows):
        raise ValueError(f"a row has not the {len(head)} columns of the first")
    table = {
        title: np.array([float(row[k]) if row[k].strip() else np.nan for row in rows[1:]])
        for k, title in enumerate(head)
    }
    tau = table.pop("tau")
    columns: Mapping[str, NDArray[np.float64]] = {
        axis: values
        for title, values in sorted(table.items(), key=lambda item: item[0] not in _GROUPS)
        for axis in _GROUPS.get(title, (title,))
    }
    return {
        axis: _checked(name, tau[~np.isnan(values)], values[~np.isnan(values)])
        for axis, values in columns.items()
        if not np.isnan(values).all()
    }


def _checked(
    name: str,
    tau: NDArray[np.float64],
    deviation: NDArray[np.float64],
    edf: NDArray[np.float64] | None = None,
) -> ReferenceCurve:
    """Return a reference whose logarithms can be interpolated."""
    for values in (tau, deviation) if edf is None else (tau, deviation, edf):
        if not (np.isfinite(values).all() and (values > 0.0).all()):
            raise ValueError("averaging times and deviations must be positive numbers")
    if (np.diff(tau) <= 0.0).any():
        raise ValueError("averaging times must ascend")
    return ReferenceCurve(name, tau, deviation, edf)
