"""Change with date and temperature, from repeats of the same units.

Every unit has its own level; only how its runs differ among themselves counts. Values less the mean
of their unit are regressed on date and mean temperature less the means of those, by least squares:

    y_ij - y_i = b_date (t_ij - t_i) + b_temperature (T_ij - T_i) + e_ij

with as many degrees of freedom less as there are units. Coefficients enter as logarithms, levels as
they are. Without repeats nothing can be said: boards that were measured later may be other boards.
Of twenty intervals of 95 % one leaves zero out by chance, so a slope is called seen at 1 % for all
slopes of the lot together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from allanscope.fleet.lot import Lot
from allanscope.fleet.outliers import FALSE_ALARMS
from allanscope.quantities import MAIN_LETTERS

__all__ = ["Drift", "drifts_of", "started_days"]

Floats = NDArray[np.float64]

DAY_S = 86400.0
LEAST = {"date": 1.0, "temperature": 2.0}
"""Days and degC that runs of one unit must be apart, rms, before anything is said."""

FEWEST_FREEDOM = 4


@dataclass(frozen=True, slots=True)
class Drift:
    """The slope of one quantity.

    Attributes
    ----------
    on : str
        ``date`` (per day) or ``temperature`` (per degC).
    slope, error : float
        And half of its 95 % interval; relative for coefficients, in the axis' unit for levels.
    p_value : float
        Probability of such a slope where there is none.
    runs : int
        That it rests on.
    is_significant : bool
        Whether it differs from zero, all slopes of the lot considered.
    """

    axis: str
    quantity: str
    on: str
    slope: float
    error: float
    p_value: float
    runs: int
    is_significant: bool = False


def drifts_of(lot: Lot) -> list[Drift]:
    """Return the slopes of coefficients and levels of all axes, as far as repeats tell."""
    found: list[Drift] = []
    for axis in lot.axes:
        here = lot.of_axis(axis)
        for name in MAIN_LETTERS:
            some = here.detected(name)
            found += _slopes(some, axis, name, np.log(some[f"{name}_value"]))
        known = here.where(np.isfinite(here["level_mean"]))
        found += _slopes(known, axis, "level", known["level_mean"])
    level = FALSE_ALARMS / max(len(found), 1)
    return [replace(one, is_significant=one.p_value < level) for one in found]


def started_days(lot: Lot) -> Floats:
    """Return when each run began, in days since 1970; NaN where the recording does not say."""

    def day(text: str | None) -> float:
        try:
            return datetime.fromisoformat(text or "").timestamp() / DAY_S
        except ValueError:
            return np.nan

    return np.array([day(text) for text in lot["started"]], np.float64)


def _slopes(lot: Lot, axis: str, quantity: str, values: Floats) -> list[Drift]:
    from scipy.stats import t

    if len(lot) == 0:
        return []
    _, of, repeats = np.unique(lot.units, return_inverse=True, return_counts=True)
    regressors = {
        "date": started_days(lot),
        "temperature": (lot["temperature_lowest"] + lot["temperature_highest"]) / 2.0,
    }

    def centred(column: Floats) -> Floats:
        return column - (np.bincount(of, column) / repeats)[of]

    columns = {name: centred(column) for name, column in regressors.items()}
    told = {
        name: column
        for name, column in columns.items()
        if np.isfinite(column).all() and np.sqrt(np.mean(column**2)) >= LEAST[name] / 2.0
    }
    freedom = len(values) - len(repeats) - len(told)
    if not told or freedom < FEWEST_FREEDOM:
        return []
    design = np.column_stack(list(told.values()))
    slope, _, rank, _ = np.linalg.lstsq(design, centred(values), rcond=None)
    if rank < design.shape[1]:
        return []
    residual = centred(values) - design @ slope
    covariance = np.linalg.inv(design.T @ design) * float(residual @ residual) / freedom
    sigma = np.maximum(np.sqrt(np.diag(covariance)), np.finfo(np.float64).tiny)
    p_value = 2.0 * t.sf(np.abs(slope) / sigma, freedom)
    wide = float(t.isf(0.025, freedom))
    return [
        Drift(axis, quantity, name, float(b), wide * float(s), float(p), len(values))
        for name, b, s, p in zip(told, slope, sigma, p_value, strict=True)
    ]
