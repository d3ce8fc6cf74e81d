"""What is to be said of a lot first, and of each unit that does not belong."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from allanscope.analysis import (
    NOTICEABLE_LOSS,
    Grade,
    Verdict,
    VerdictLine,
    simulation_notice,
)
from allanscope.fleet.effects import SIZES, SharedEffect, effects_in
from allanscope.fleet.lot import TAUS, Lot
from allanscope.fleet.outliers import (
    FALSE_ALARMS,
    FEWEST_UNITS,
    Outlier,
    deviation_errors,
    outlying_units,
    outlying_values,
)
from allanscope.fleet.repeats import (
    excess_of_repeats,
    unit_estimates,
    unit_means,
)
from allanscope.labels import kind_name
from allanscope.quantities import LEVEL, MAIN_LETTERS, TWO_SIDED_95, counted, number, symbols

__all__ = [
    "AverageLimits",
    "Finding",
    "average_limits",
    "findings",
    "levels_of_units",
    "lot_verdict",
    "rates_of_units",
    "run_remarks",
    "simulation_banner",
    "units_named",
]

Values = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.str_]]
"""Of units: values, their standard errors, names."""

DECADE = 4
"""Steps of `TAUS`."""
LEAST_EDF = 4.0
"""With fewer degrees of freedom the logarithm of a deviation is far from normal."""

MODEL_LEVEL = 0.01
"""Probability at which a single run says that the model does not explain it."""


@dataclass(frozen=True, slots=True)
class AverageLimits:
    """Part average limits of one quantity and axis: six robust deviations about the median.

    The robust deviation is a quartile range / 1.35 (AEC-Q001, part average testing), of logarithms
    for a coefficient, which is positive and scatters by factors. A custom of the trade: it knows
    neither the units' own errors nor how many are looked at, which `findings` does.

    Attributes
    ----------
    axis, quantity : str
        ``N``, ``B``, ``K`` or ``level``.
    lower, middle, upper : float
        Limits and median.
    units : int
        That have a value.
    outside : tuple of str
        Units beyond the limits.
    """

    axis: str
    quantity: str
    lower: float
    middle: float
    upper: float
    units: int
    outside: tuple[str, ...]


AVERAGE_SIGMAS, QUARTILES = 6.0, 1.35
"""AEC-Q001: limits, and quartile range of a normal distribution, in standard deviations."""


def average_limits(lot: Lot) -> list[AverageLimits]:
    """Return the part average limits of N, B, K and of the level of gyros."""
    found = []
    for axis in lot.axes:
        here = lot.of_axis(axis)
        for name in MAIN_LETTERS:
            shown = here.detected(name)
            logs = np.log(shown[f"{name}_value"])
            found += _average_limits(axis, name, *_of_units(logs, 0.0 * logs, shown.units))
        if axis.startswith("g"):
            found += _average_limits(axis, "level", *levels_of_units(here))
    return found


def _average_limits(
    axis: str,
    name: str,
    values: NDArray[np.float64],
    errors: NDArray[np.float64],
    units: NDArray[np.str_],
) -> list[AverageLimits]:
    if len(values) < FEWEST_UNITS:
        return []
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
    reach = AVERAGE_SIGMAS * (high - low) / QUARTILES
    outside = units[np.abs(values - middle) > reach].tolist()
    limits = np.array([middle - reach, middle, middle + reach])
    lower, centre, upper = limits if name == "level" else np.exp(limits)
    return [
        AverageLimits(
            axis, name, float(lower), float(centre), float(upper), len(values), tuple(outside)
        )
    ]


@dataclass(frozen=True, slots=True)
class Finding:
    """Why a unit is named; `quantity` is the coefficient that is far from the others'."""

    unit: str
    axis: str
    reason: str
    quantity: str = ""


def units_named(named: Sequence[Finding], axis: str, quantity: str) -> list[str]:
    """Return the units that are named for a quantity of an axis."""
    return [one.unit for one in named if (one.axis, one.quantity) == (axis, quantity)]


def findings(lot: Lot) -> list[Finding]:
    """Return the units that stand out, each with the reason, those farthest out first."""
    gyros = [axis for axis in lot.axes if axis.startswith("g")]
    shapes, sizes = list(_shapes(lot)), list(_sizes(lot))
    comparisons = len(lot.axes) * len(MAIN_LETTERS) + len(gyros) + 1 + len(shapes) + len(sizes)
    far = []
    for axis in lot.axes:
        for name in MAIN_LETTERS:
            units = unit_estimates(lot.of_axis(axis), name)
            for one in outlying_units(units, comparisons) if units is not None else []:
                reason = f"{name} is {number(one.value / one.usual)} times that of the others"
                far.append((one, Finding(one.unit, axis, _with_significance(reason, one), name)))
    # The level of an accelerometer is the way it lies.
    for axis in gyros:
        for one in outlying_values(*levels_of_units(lot.of_axis(axis)), comparisons):
            reading = LEVEL[lot.of_axis(axis)["sensor_unit"][0]]
            value, usual = (number(x * reading.factor) for x in (one.value, one.usual))
            reason = f"level is {value} {symbols(reading.unit)}, that of the others {usual}"
            far.append((one, Finding(one.unit, axis, _with_significance(reason, one))))
    for one in outlying_values(*rates_of_units(lot), comparisons):
        reason = f"rate is {number(one.value, 6)} Hz, that of the others {number(one.usual, 6)}"
        far.append((one, Finding(one.unit, "all", _with_significance(reason, one))))
    for axis, kind, name, known in sizes:
        for one in outlying_values(*known, comparisons):
            value, usual = number(one.value), number(one.usual)
            reason = f"{name} of {kind_name(kind)} is {value}, that of the others {usual}"
            far.append((one, Finding(one.unit, axis, _with_significance(reason, one))))
    # What N, B and K say is not said again, and of a curve the farthest rise alone.
    told = {(found.unit, found.axis) for _, found in far if found.quantity}
    rises: dict[tuple[str, str], tuple[Outlier, Finding]] = {}
    for axis, tau, first, known in shapes:
        for one in outlying_values(*known, comparisons):
            where = one.unit, axis
            if where in told or (where in rises and abs(rises[where][0].score) > abs(one.score)):
                continue
            times = number(float(np.exp(one.value - one.usual)))
            reason = (
                f"the curve has another shape: from {number(first, 1)} to {number(tau)} s it rises "
                f"{times} times as much as those of the others"
            )
            rises[where] = one, Finding(one.unit, axis, _with_significance(reason, one), "curve")
    far += rises.values()
    ordered = [found for _, found in sorted(far, key=lambda pair: -abs(pair[0].score))]
    dead = "no noise could be fitted: dead, saturated or too short"
    return [*ordered, *_in_runs(lot, ~np.isfinite(lot["N_value"]), dead)]


def _with_significance(reason: str, one: Outlier) -> str:
    chance = "less than 0.0001" if one.p_value < 1e-4 else number(one.p_value, 2)
    return f"{reason}, {number(abs(one.score))} standard deviations away (by chance: {chance})"


def _shapes(lot: Lot) -> Iterator[tuple[str, float, float, Values]]:
    """Yield axis, averaging time, the shortest one, and by how much the curve rises between them.

    Each is the logarithm of a ratio of two Allan deviations, so that a unit with more noise of the
    same kind has the same shape. One averaging time a decade is looked at.
    """
    if "curve" not in lot.columns:
        return
    for axis in lot.axes:
        here = lot.of_axis(axis)
        known = np.isfinite(here["curve"]) & (here["curve_edf"] > LEAST_EDF)
        shown = np.flatnonzero(known.sum(axis=0) > 0.5 * len(here))
        if len(shown) <= DECADE:
            continue
        first = shown[0]
        for at in range(first + DECADE, shown[-1] + 1, DECADE):
            both = known[:, first] & known[:, at]
            if np.count_nonzero(both) == 0:
                continue
            curve, edf = here["curve"][both].astype(float), here["curve_edf"][both].astype(float)
            rise = np.log(curve[:, at] / curve[:, first])
            error = np.hypot(deviation_errors(rise, edf[:, at]), np.sqrt(0.5 / edf[:, first]))
            values = _of_units(rise, error, here.units[both])
            if len(values[0]) >= FEWEST_UNITS:
                yield axis, float(TAUS[at]), float(TAUS[first]), values


def _sizes(lot: Lot) -> Iterator[tuple[str, str, str, Values]]:
    """Yield axis, kind, parameter and values of effects that many units show, slopes among them."""
    if "effects" not in lot.columns:
        return
    found: dict[tuple[str, str, str], list[tuple[str, float, float]]] = defaultdict(list)
    for one in effects_in(lot):
        if one.has_frequency:
            continue  # which line is which is asked elsewhere
        for name in SIZES:
            value, lower, upper, _ = one.parameters.get(name, (np.nan, np.nan, np.nan, ""))
            if np.isfinite([value, lower, upper]).all():
                error = (upper - lower) / (2.0 * TWO_SIDED_95)
                found[one.axis, one.kind, name].append((one.unit, value, error))
    for (axis, kind, name), runs in sorted(found.items()):
        units, values, errors = (np.array(column) for column in zip(*runs, strict=True))
        if len(np.unique(units)) >= FEWEST_UNITS:
            yield axis, kind, name, _of_units(values, errors, units)


def levels_of_units(lot: Lot) -> Values:
    """Return the levels of units, with what their repeats differ by as errors, and names."""
    here = lot.where(np.isfinite(lot["level_mean"]))
    return _of_units(here["level_mean"], np.zeros(len(here)), here.units)


def rates_of_units(lot: Lot) -> Values:
    """Return the sample rates of units of the lot's nominal rate, errors and names."""
    _, first = np.unique(lot["recording"].astype(np.str_), return_index=True)
    nominal = lot["nominal_hz"][first]
    rate, error = lot["measured_hz"][first], lot["rate_uncertainty_ppm"][first] * 1e-6
    known = np.isfinite(rate) & np.isfinite(nominal) & np.isfinite(error)
    if known.any():
        rates, counts = np.unique(nominal[known], return_counts=True)
        known &= nominal == rates[counts.argmax()]
    return _of_units(rate[known], (rate * error)[known] / TWO_SIDED_95, lot.units[first][known])


def _of_units(
    values: NDArray[np.float64], errors: NDArray[np.float64], units: NDArray[np.str_]
) -> Values:
    names, mean, error = unit_means(values, errors, units, excess_of_repeats(values, errors, units))
    return mean, error, names


def run_remarks(lot: Lot) -> list[Finding]:
    """Return remarks on single runs of a unit, which need not set it apart from the others.

    Each axis of each run is tested against its model at 1 %. Of a hundred good ones one is refused,
    so here it takes a probability that the whole lot reaches once in a hundred times.
    """
    noisy = "noise density above the datasheet's"
    by_chance = lot["residual_after_p_value"] * len(lot) > FALSE_ALARMS
    refused = (lot["explained"] == 0.0) & np.isfinite(lot["residual_after_chi2_per_dof"])
    unexplained = "the model does not explain all of the data"
    return [
        *_in_runs(lot, lot["datasheet_verdict"] == "worse", noisy),
        *_in_runs(lot, refused & ~by_chance, unexplained),
    ]


def _in_runs(lot: Lot, mask: NDArray[np.bool_], reason: str) -> list[Finding]:
    """Return which units and axes are meant, and in how many of their runs."""
    runs = Counter(_pairs(lot))
    found = Counter(_pairs(lot.where(mask)))
    return [
        Finding(unit, axis, f"{reason}, in {count} of {runs[unit, axis]} runs")
        for (unit, axis), count in sorted(found.items())
    ]


def _pairs(lot: Lot) -> list[tuple[str, str]]:
    return list(zip(lot["unit"].tolist(), lot["axis"].tolist(), strict=True))


def lot_verdict(
    lot: Lot,
    named: list[Finding],
    shared: list[SharedEffect],
    failures: Mapping[str, str],
    limit_lines: Sequence[VerdictLine] = (),
) -> Verdict:
    """Return the verdict of the report; `limit_lines` are on limits and on another lot."""
    units = len(np.unique(lot.units))
    runs = len(set(lot["recording"].tolist()))
    bad = sorted({one.unit for one in named})
    title = "No unit stands out"
    if bad:
        title = f"{len(bad)} of {counted(units, 'unit')} stand{'s' * (len(bad) == 1)} out"
    axes = counted(len(lot.axes), "axis", "axes")
    size = f"{counted(units, 'unit')}, {counted(runs, 'recording')}, {axes}"
    lines = [
        VerdictLine("bad", title, f"{_some(bad)}; {size}")
        if bad
        else VerdictLine("good", title, size),
        *limit_lines,
        *_run_lines(lot),
        *_loss_lines(lot),
        *_rack_lines(shared, units),
    ]
    if failures:
        lines.append(VerdictLine("bad", "no result", f"{len(failures)} of the recordings"))
    is_bad = bad or failures or any(line.grade == "bad" for line in limit_lines)
    banner = simulation_banner(lot)
    return Verdict("bad" if is_bad else "good", title, tuple(lines), banner=banner)


def simulation_banner(lot: Lot) -> str:
    """Return the notice above a page with recordings whose samples no part measured; else empty."""
    if "origin" not in lot.columns:  # a table of an earlier version
        return ""
    origins = dict(zip(lot["recording"].tolist(), lot["origin"].tolist(), strict=True))
    notices = [simulation_notice(origin or "") for origin in origins.values()]
    simulated = [notice for notice in notices if notice is not None]
    if not simulated:
        return ""
    [head] = {head for head, _ in simulated}
    part = (
        ""
        if len(simulated) == len(notices)
        else f" in {len(simulated)} of {len(notices)} recordings"
    )
    return f"{head}{part}: {'; '.join(sorted({why for _, why in simulated}))}"


def _run_lines(lot: Lot) -> list[VerdictLine]:
    """Return how many axes of runs are noisier than the datasheet, and how many unexplained."""
    lines = []
    worse = int(np.count_nonzero(lot["datasheet_verdict"] == "worse"))
    compared = sum(one is not None for one in lot["datasheet_verdict"].tolist())
    if worse:
        text = f"{worse} of {compared} axes of runs are noisier than the typical density there"
        lines.append(VerdictLine("note", "datasheet", text))
    asked = np.isfinite(lot["residual_after_p_value"])
    refused = int(np.count_nonzero(asked & (lot["explained"] == 0.0)))
    if refused:
        usual = number(MODEL_LEVEL * np.count_nonzero(asked), 2)
        text = (
            f"{refused} of {np.count_nonzero(asked)} axes of runs are not explained at 1 %; "
            f"chance alone gives {usual}"
        )
        lines.append(VerdictLine("note", "model", text))
    return lines


def _loss_lines(lot: Lot) -> list[VerdictLine]:
    """Return how many recordings lost samples, and which lost most."""
    names, first = np.unique(lot["recording"].astype(np.str_), return_index=True)
    lost = lot["lost_samples"][first]
    if not (lost > 0).any():
        return []
    share = lost / (lot["samples"][first] + lost)
    most = int(np.nanargmax(share))
    text = (
        f"{np.count_nonzero(lost > 0)} of {len(names)} recordings; most in {names[most]} "
        f"({number(100.0 * share[most], 2)} %)"
    )
    grade: Grade = "bad" if share[most] > NOTICEABLE_LOSS else "note"
    return [VerdictLine(grade, "lost samples", text)]


def _rack_lines(shared: list[SharedEffect], units: int) -> list[VerdictLine]:
    return [
        VerdictLine(
            "note",
            "shared",
            f"{one.kind.replace('_', ' ')} at {number(one.frequency_hz, 5)} Hz on "
            f"{len(one.units)} of {units} units: from the bench, not from the units",
        )
        for one in shared
        if one.of_rack
    ]


def _some(names: list[str], most: int = 8) -> str:
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")
