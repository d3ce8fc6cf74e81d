"""The statistics of a lot on made-up results whose truth is known, and the page that tells them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2, norm, t

from allanscope.fleet.drift import drifts_of
from allanscope.fleet.effects import effects_in, replications, shared_effects
from allanscope.fleet.lot import TAUS, EffectColumn, Lot, rows_of, schema, write_table
from allanscope.fleet.outliers import (
    Outlier,
    deviation_errors,
    outlying_units,
    outlying_values,
)
from allanscope.fleet.page import render_lot
from allanscope.fleet.pictures import (
    curve_bands,
    curves_picture,
    distribution_picture,
    history_picture,
)
from allanscope.fleet.repeats import UnitEstimates, log_sigma, spread_of, unit_estimates
from allanscope.fleet.typical_value import typical_of
from allanscope.fleet.verdict import (
    average_limits,
    findings,
    lot_verdict,
    run_remarks,
    simulation_banner,
)

Floats = NDArray[np.float64]

UNITS, RUNS = 12, 3
N_TYPICAL = {"gx": 0.0038, "az": 9e-5}
BETWEEN, WITHIN = 0.10, 0.03
PER_DEGREE = 0.004
ODD = "unit-07"


def line(frequency: float, amplitude: float = 0.01) -> dict[str, Any]:
    def parameter(name: str, value: float, width: float, unit: str) -> dict[str, Any]:
        limits = {"lower": value - width, "upper": value + width}
        return {"name": name, "value": value, "text": None, "unit": unit, **limits}

    return {
        "kind": "sinusoid",
        "parameters": [
            parameter("frequency", frequency, 1e-3, "Hz"),
            parameter("amplitude", amplitude, 5e-4, "dps"),
        ],
        "axes": ["gx"],
        "equivalent": [],
        "words": None,
    }


def step(time_s: float) -> dict[str, Any]:
    parameters = [
        {"name": "time", "value": time_s, "text": None, "lower": None, "upper": None, "unit": "s"}
    ]
    common = {"axes": ["gx"], "equivalent": [], "words": None}
    return {"kind": "step", "parameters": parameters, **common}


def effects_of(unit: str, number: int, run: int, axis: str) -> list[dict[str, Any]]:
    if axis != "gx":
        return []
    found = [line(50.0 + 0.01 * run)] if number < 8 else []
    if number == 2:
        found += [line(17.3, 0.01 if run else 0.02)]
    if unit == ODD and run == 1:
        found += [step(100.0)]
    return found


def rows() -> list[dict[str, Any]]:
    rng, small = np.random.default_rng(3), np.random.default_rng(4)
    start = datetime(2026, 3, 1, tzinfo=UTC)
    found = []
    for number in range(UNITS):
        unit = f"unit-{number:02d}"
        own = {axis: BETWEEN * rng.standard_normal() for axis in N_TYPICAL}
        for run in range(RUNS):
            degrees = 20.0 + 10.0 * run + rng.uniform(-1, 1)
            for axis, typical in N_TYPICAL.items():
                noise = own[axis] + WITHIN * rng.standard_normal() + PER_DEGREE * (degrees - 25.0)
                n = typical * float(np.exp(noise)) * (2.5 if unit == ODD and axis == "gx" else 1.0)
                sensor_unit = "dps" if axis == "gx" else "g"
                known: dict[str, Any] = dict.fromkeys(schema().names)
                known |= {
                    **{"recording": f"/lot/{unit}/{run}.mcap", "unit": unit, "axis": axis},
                    **{"sensor_unit": sensor_unit, "part": "LSM6DSM", "samples": 1000},
                    "started": (start + timedelta(days=run, hours=number)).isoformat(),
                    **{"duration_s": 3600.0, "lost_samples": 0, "damaged_places": 0},
                    **{"temperature_lowest": degrees - 0.1, "temperature_highest": degrees + 0.1},
                    "level_mean": 0.5 + 0.02 * degrees + 1e-4 * small.standard_normal(),
                    **{"N_value": n, "N_lower": n * 0.98, "N_upper": n * 1.02},
                    **{"N_detected": True, "B_detected": False, "B_upper": 1e-3},
                    **{"datasheet_limit": typical * 1.5, "datasheet_verdict": "typical"},
                    **{"explained": True, "residual_after_chi2_per_dof": 1.0},
                    "residual_after_p_value": 0.5,
                    **{"effects": effects_of(unit, number, run, axis), "remarks": []},
                }
                found.append(known)
    found[0] |= {"explained": False, "residual_after_p_value": 5e-3}  # as one run in two hundred
    found[2] |= {"explained": False, "residual_after_p_value": 1e-6}
    found[4] |= {"datasheet_verdict": "worse"}
    return found


@pytest.fixture(scope="module")
def lot(tmp_path_factory: pytest.TempPathFactory) -> Lot:
    table = tmp_path_factory.mktemp("table") / "lot.parquet"
    assert write_table(table, rows()) == UNITS * RUNS * 2
    return Lot.read(table)


def runs(values: Floats, sigma: Floats, units: NDArray[np.str_], name: str = "N") -> Lot:
    """Return rows with well-known coefficients: errors of their logarithms are given."""
    wide = np.exp(1.959964 * sigma)
    columns = {"value": values, "lower": values / wide, "upper": values * wide}
    columns |= {"detected": np.ones(len(values))}
    named = {f"{name}_{part}": column for part, column in columns.items()}
    return Lot({"unit": units.astype(object), "axis": units.astype(object), **named})


def far(values: Floats, sigma: Floats, units: NDArray[np.str_], comparisons: int) -> list[Outlier]:
    known = unit_estimates(runs(values, sigma, units), "N")
    assert known is not None
    return outlying_units(known, comparisons)


def test_spread_is_parted_into_units_and_repeats() -> None:
    rng = np.random.default_rng(1)
    units = np.repeat([f"{u:03}" for u in range(200)], rng.integers(1, 5, 200))
    own = dict(zip(np.unique(units), BETWEEN * rng.standard_normal(200), strict=True))
    logs = np.array([own[u] for u in units]) + WITHIN * rng.standard_normal(len(units))
    one = spread_of(np.exp(logs), np.full(len(units), WITHIN), units)
    assert one is not None
    assert one.within == pytest.approx(WITHIN, rel=0.15)
    assert one.sampling == pytest.approx(WITHIN)
    assert one.p_alike < 1e-6
    known = unit_estimates(runs(np.exp(logs), np.full(len(units), WITHIN), units), "N")
    assert known is not None
    assert len(known.names) == 200
    assert typical_of(known).scatter == pytest.approx(BETWEEN, rel=0.15)


def test_units_that_are_alike_are_not_said_to_differ() -> None:
    rng = np.random.default_rng(5)
    units = np.repeat([f"{u:03}" for u in range(12)], 3)

    def p_alike() -> float:
        one = spread_of(np.exp(WITHIN * rng.standard_normal(36)), np.full(36, WITHIN), units)
        assert one is not None
        return one.p_alike

    found = np.array([p_alike() for _ in range(400)])
    assert np.mean(found < 0.05) == pytest.approx(0.05, abs=0.033)  # three sigma
    assert np.mean(found) == pytest.approx(0.5, abs=0.045)


def test_without_repeats_the_scatter_of_single_runs_is_taken_off() -> None:
    rng = np.random.default_rng(2)
    units = np.array([f"{u:03}" for u in range(400)])
    values = np.exp(np.hypot(0.05, 0.1) * rng.standard_normal(400))
    one = spread_of(values, np.full(400, 0.1), units)
    assert one is not None
    assert np.isnan(one.within)
    known = unit_estimates(runs(values, np.full(400, 0.1), units), "N")
    assert known is not None
    assert typical_of(known).scatter == pytest.approx(0.05, rel=0.4)
    single = unit_estimates(runs(np.array([1.0, 2.0]), np.full(2, 0.1), np.array(["a", "a"])), "N")
    assert single is not None
    assert np.isnan(typical_of(single).scatter)


def test_an_interval_is_a_standard_error_of_the_logarithm() -> None:
    value = log_sigma(np.array([np.exp(-0.196), np.nan, 0.0]), np.array([np.exp(0.196), 1.0, 1.0]))
    assert value[0] == pytest.approx(0.1, rel=1e-4)
    assert np.isnan(value[1:]).all()


@pytest.mark.parametrize("count", [6, 10, 40])
def test_clean_lots_have_no_outliers(count: int) -> None:
    rng = np.random.default_rng(count)
    names = np.array([f"{u:03}" for u in range(count)])
    alarms = sum(
        bool(far(np.exp(0.1 * rng.standard_normal(count)), np.zeros(count), names, 1))
        for _ in range(400)
    )
    assert alarms <= 12  # 1 % of 400 are 4; more than 12 happen once in 3000


def test_two_bad_units_do_not_hide_each_other() -> None:
    rng = np.random.default_rng(4)
    values = np.exp(0.05 * rng.standard_normal(12))
    values[[3, 8]] *= 2.0
    names = np.array([f"{u:02}" for u in range(12)])
    assert {one.unit for one in far(values, np.zeros(12), names, 6)} == {"03", "08"}
    unsure = np.zeros(12)
    unsure[3] = 0.5  # a run too short to say so
    assert {one.unit for one in far(values, unsure, names, 6)} == {"08"}


@pytest.mark.parametrize("scatter", [0.0, 0.02, 0.1])
def test_short_runs_among_long_ones_are_no_outliers(scatter: float) -> None:
    """180 long runs and 20 short ones, which are 50 times less sure."""
    rng = np.random.default_rng(int(100 * scatter))
    sigma = np.r_[np.full(180, 0.001), np.full(20, 0.05)]
    names = np.array([f"{u:03}" for u in range(200)])
    alarms = sum(
        bool(far(np.exp(np.hypot(scatter, sigma) * rng.standard_normal(200)), sigma, names, 1))
        for _ in range(80)
    )
    assert alarms <= 4  # 1 % of 80 are 0.8; more than 4 happen once in 700
    # A long run that is off by as much as the short ones scatter is told from them.
    values = np.exp(np.hypot(scatter, sigma) * rng.standard_normal(200))
    values[7] = np.exp(max(8.0 * scatter, 0.05))
    assert {one.unit for one in far(values, sigma, names, 18)} == {"007"}


def test_adjusted_p_values_are_students_where_errors_are_equal() -> None:
    rng = np.random.default_rng(6)
    values = rng.standard_normal(12)
    values[4] = 8.0
    rest = np.delete(values, 4)
    distance = (8.0 - rest.mean()) / (rest.std(ddof=1) * np.sqrt(1.0 + 1.0 / 11.0))
    [one] = outlying_values(values, np.zeros(12), np.arange(12).astype(str), 5)
    assert one.p_value == pytest.approx(5 * 12 * 2.0 * t.sf(distance, 10), rel=1e-6)


def test_a_low_estimate_with_a_wide_interval_of_its_logarithm_is_no_outlier() -> None:
    """A run of a minute knows K to 26 %, up and down: 0.55 of the lot is 2.3 of that below."""
    values = np.r_[np.exp(0.03 * np.random.default_rng(2).standard_normal(29)), 0.55]
    sigma = np.r_[np.full(29, 0.02), 0.26]
    names = np.array([f"{u:02}" for u in range(30)])
    assert far(values, sigma, names, 1) == []
    values[-1] = np.exp(-6.0 * 0.26)
    assert [one.unit for one in far(values, sigma, names, 1)] == ["29"]


@pytest.mark.parametrize("edf", [5.0, 10.0, 40.0])
def test_deviations_of_few_degrees_of_freedom_are_as_far_out_as_they_are_rare(edf: float) -> None:
    """Without the cube root one that is low as often as -3.5 sigma seems -6 sigma away (edf 5)."""
    normal = np.array([-3.5, -2.0, 2.0, 3.5])
    logs = 0.5 * np.log(chi2.ppf(norm.cdf(normal), edf) / edf)
    many = np.zeros(200)
    error = deviation_errors(np.r_[many, logs], np.full(204, edf))[200:]
    np.testing.assert_allclose(logs / error, normal, atol=0.45)


def planted(
    rng: np.random.Generator, count: int, sigma: float, scatter: float
) -> tuple[Lot, float]:
    """Return runs with B about 3.6, detected above three sigma, and the median of those."""
    truth = 3.6 * np.exp(scatter * rng.standard_normal(count))
    value = np.maximum(truth + sigma * rng.standard_normal(count), 0.0)
    seen = value > 3.0 * sigma
    columns = {
        "value": value,
        "lower": np.where(seen, value - 1.96 * sigma, 0.0),
        "upper": value + 1.96 * sigma,
        "detected": seen.astype(float),
    }
    units = np.array([f"{u:03}" for u in range(count)])
    named = {f"B_{part}": column for part, column in columns.items()}
    lot = Lot({"unit": units.astype(object), "axis": units.astype(object), **named})
    return lot, float(np.median(value[seen]))


def test_what_is_typical_takes_runs_that_give_only_a_limit_into_account() -> None:
    rng = np.random.default_rng(8)
    held = 0
    for _ in range(60):
        lot, of_detected = planted(rng, 40, 1.4, 0.15)
        units = unit_estimates(lot, "B")
        assert units is not None
        one = typical_of(units)
        assert of_detected > 4.2  # those detected only are the large ones
        assert one.value == pytest.approx(3.6, rel=0.25)
        held += one.lower <= 3.6 <= one.upper
    assert held >= 51  # 95 % of 60 are 57; fewer than 51 happen once in 100


def test_a_lot_that_shows_nothing_has_an_upper_limit() -> None:
    columns = {"value": np.full(10, np.nan), "lower": np.zeros(10), "upper": np.full(10, 2.0)}
    columns |= {"detected": np.zeros(10)}
    units = np.arange(10).astype(str).astype(object)
    named = {f"K_{part}": column for part, column in columns.items()}
    known = unit_estimates(Lot({"unit": units, "axis": units, **named}), "K")
    assert known is not None
    one = typical_of(known)
    assert np.isnan(one.value)
    assert one.lower == 0.0
    assert 0.4 < one.upper < 2.0
    assert outlying_units(known, 1) == []


def test_level_and_rate_are_judged_as_well(lot: Lot) -> None:
    levels, rates = lot["level_mean"].copy(), np.full(len(lot), 104.0)
    rates += 0.1 * np.repeat(np.random.default_rng(9).standard_normal(UNITS), 2 * RUNS)
    levels[(lot.units == "unit-03") & (lot["axis"] == "gx")] = 25.0
    rates[lot.units == "unit-05"] = 98.0
    more = {"level_mean": levels, "measured_hz": rates, "nominal_hz": np.full(len(lot), 104.0)}
    more |= {"rate_uncertainty_ppm": np.full(len(lot), 1.0)}
    named = findings(Lot({**lot.columns, **more}))
    assert {(one.unit, one.axis) for one in named} == {
        (ODD, "gx"),
        ("unit-03", "gx"),
        ("unit-05", "all"),
    }
    [level] = [one for one in named if one.unit == "unit-03"]
    assert level.reason.startswith("level is 25000 mdps, that of the others 1")


def with_curves(lot: Lot, odd: str, times: float) -> Lot:
    """Return the lot with curves of white noise that scatter as theirs do; one rises at the end."""
    rng = np.random.default_rng(12)
    edf = np.tile(np.clip(3600.0 / TAUS, 1.0, 1e5), (len(lot), 1))
    curve = lot["N_value"][:, None] * TAUS**-0.5
    curve *= np.exp(rng.standard_normal(curve.shape) * np.sqrt(0.5 / edf))
    rises = np.interp(np.log(TAUS), np.log([1.0, 100.0]), np.log([1.0, times]))
    curve[(lot.units == odd) & (lot["axis"] == "gx")] *= np.exp(rises)
    return Lot({**lot.columns, "curve": curve, "curve_edf": edf})


def test_a_curve_of_another_shape_is_named_and_drawn(lot: Lot) -> None:
    named = findings(with_curves(lot, "unit-04", 4.0))
    assert {(one.unit, one.axis) for one in named} == {(ODD, "gx"), ("unit-04", "gx")}
    [shape] = [one for one in named if one.unit == "unit-04"]
    assert shape.reason.startswith("the curve has another shape: from 0.001 to")
    plain = with_curves(lot, "unit-04", 1.0)
    assert {one.unit for one in findings(plain)} == {ODD}, "more noise is no other shape"
    picture = curves_picture(curve_bands(plain), "dps", findings(plain))
    assert picture is not None
    assert ODD in picture.svg()
    assert curves_picture(curve_bands(lot), "dps") is None, "a table without curves"


def test_the_table_holds_the_curve_as_far_as_it_is_trusted() -> None:
    tau = np.array([0.01, 0.1, 1.0, 10.0])
    told = {"tau": tau, "deviation": tau**-0.5, "edf": 100.0 / tau, "trusted": tau < 5.0}
    axis = {"unit": "dps", "remarks": [], "curves": {"oadev": told}}
    analysis: dict[str, Any] = dict.fromkeys(("part", "allanscope", "duration_s", "samples"))
    analysis |= dict.fromkeys(("lost_samples", "unknown_losses", "segments"), 0)
    analysis |= {"input": {"sha256": ""}, "link": {}, "temperature": {}, "remarks": []}
    analysis["rate"] = dict.fromkeys(("nominal_hz", "measured_hz", "uncertainty_ppm"))
    analysis["axes"] = {"gx": axis}
    [row] = rows_of("a", "b", {"analysis": analysis, "circumstances": {}})
    known = (TAUS > 0.0099) & (TAUS < 1.01)
    np.testing.assert_allclose(np.array(row["curve"])[known], TAUS[known] ** -0.5)
    np.testing.assert_allclose(np.array(row["curve_edf"])[known], 100.0 / TAUS[known])
    assert np.isnan(np.array(row["curve"])[~known]).all()


def test_the_slope_of_an_effect_is_judged_where_many_units_have_it(lot: Lot) -> None:
    effects: list[Any] = []
    rng = np.random.default_rng(5)
    for unit, axis in zip(lot["unit"], lot["axis"], strict=True):
        slope = (0.05 if unit == "unit-09" else 0.01) + 2e-4 * rng.standard_normal()
        told = {"name": "slope", "value": slope, "lower": slope - 4e-4, "upper": slope + 4e-4}
        one = {"kind": "temperature", "parameters": [{**told, "unit": "dps/degC", "text": None}]}
        effects.append([one] if axis == "gx" else None)
    named = findings(Lot({**lot.columns, "effects": EffectColumn.of(effects)}))
    assert {(one.unit, one.axis) for one in named} == {(ODD, "gx"), ("unit-09", "gx")}
    [slope_of] = [one.reason for one in named if one.unit == "unit-09"]
    assert slope_of.startswith("slope of ")
    assert " is 0.05" in slope_of
    assert "that of the others 0.0" in slope_of


def test_part_average_limits_are_those_of_quartiles(lot: Lot) -> None:
    """Six quartile ranges / 1.35 about the median, of the logarithm of N."""
    [one] = [one for one in average_limits(lot) if (one.axis, one.quantity) == ("gx", "N")]
    here = lot.of_axis("gx")
    logs = [np.log(here["N_value"][here.units == unit]).mean() for unit in np.unique(here.units)]
    low, middle, high = np.quantile(logs, (0.25, 0.5, 0.75))
    expected = np.exp(middle + 6.0 * (high - low) / 1.35 * np.array([-1.0, 0.0, 1.0]))
    np.testing.assert_allclose((one.lower, one.middle, one.upper), expected)
    assert one.units == UNITS
    assert {level.axis for level in average_limits(lot) if level.quantity == "level"} == {"gx"}
    wild = lot["N_value"].copy()
    wild[lot.units == "unit-03"] *= 50.0
    [outside] = [
        one
        for one in average_limits(Lot({**lot.columns, "N_value": wild}))
        if (one.axis, one.quantity) == ("gx", "N")
    ]
    assert outside.outside == ("unit-03",)


def test_units_are_sorted_by_the_browser_without_a_script(lot: Lot) -> None:
    page = render_lot(lot, {})
    first = page.split("<h2>Units</h2>")[1].split("<tbody>")[1]
    rows = {row.split("<th>")[1].split("</th>")[0]: row for row in first.split("<tr ")[1:]}
    assert list(rows) == sorted(rows)
    place = {unit: row.split("--o5:")[1].split(";")[0] for unit, row in rows.items()}
    assert place[ODD] == "0", "it stands out most"
    assert "#by5:checked ~ .scroll tbody tr { order: var(--o5); }" in page


def test_the_odd_unit_is_named_with_its_reason(lot: Lot) -> None:
    named = findings(lot)
    assert {(one.unit, one.axis) for one in named} == {(ODD, "gx")}
    assert "N is 2." in named[0].reason
    verdict = lot_verdict(lot, named, [], {})
    assert (verdict.grade, verdict.title) == ("bad", "1 of 12 units stands out")
    told = {line.head: line.text for line in verdict.lines}
    assert told[verdict.title] == f"{ODD}; 12 units, 36 recordings, 2 axes"
    assert told["model"] == "2 of 72 axes of runs are not explained at 1 %; chance alone gives 0.72"
    assert told["datasheet"].startswith("1 of 72 axes of runs are noisier")


def test_what_a_single_run_says_does_not_set_a_unit_apart(lot: Lot) -> None:
    assert [(one.unit, one.axis, one.reason) for one in run_remarks(lot)] == [
        ("unit-00", "gx", "noise density above the datasheet's, in 1 of 3 runs"),
        ("unit-00", "gx", "the model does not explain all of the data, in 1 of 3 runs"),
    ]


def test_a_line_of_many_units_is_the_racks(lot: Lot) -> None:
    shared = shared_effects(effects_in(lot), UNITS)
    [mains] = shared  # the line at 17.3 Hz is one unit's
    assert (mains.kind, len(mains.units), mains.axes, mains.of_rack) == (
        "sinusoid",
        8,
        ("gx",),
        True,
    )
    assert mains.frequency_hz == pytest.approx(50.01)


def test_effects_are_held_against_other_runs(lot: Lot) -> None:
    found = {
        (one.unit, one.kind, round(one.frequency_hz) if np.isfinite(one.frequency_hz) else 0): one
        for one in replications(lot, effects_in(lot))
    }
    assert found["unit-00", "sinusoid", 50].replicated
    assert found["unit-00", "sinusoid", 50].agree is True
    assert found["unit-02", "sinusoid", 17].agree is False
    once = found[ODD, "step", 0]
    assert (once.found, once.runs, once.replicated, once.agree) == (1, 3, False, None)


def test_drift_is_found_among_repeats(lot: Lot) -> None:
    found = {(one.axis, one.quantity, one.on): one for one in drifts_of(lot)}
    # Temperature and date rise together here; the level depends on temperature alone.
    level = found["gx", "level", "temperature"]
    assert level.slope == pytest.approx(0.02, abs=2.0 * level.error)
    noise = found["az", "N", "temperature"]
    assert abs(noise.slope - PER_DEGREE) < 1.5 * noise.error
    assert {(one.quantity, one.on) for one in found.values() if one.is_significant} >= {
        ("level", "temperature")
    }
    assert not any(one.is_significant for one in found.values() if one.on == "date")
    single = lot.where(lot["started"] == lot["started"][0])
    assert drifts_of(single) == []


def test_the_page_tells_it_all_and_fetches_nothing(lot: Lot) -> None:
    page = render_lot(lot, {"/lot/<b>.mcap": "not a recording: /lot/<b>.mcap is not an MCAP file"})
    for text in (
        ODD,
        "50.010 Hz",
        "the rack&#39;s",
        "not found again",
        "another size",
        "replicated",
        "in 1 of 3 runs",
        "9 of 10 effects were found again",
        "<td>level</td><td>20.04 ±0.10 mdps</td>",
        "temperature (°C)",
    ):
        assert text in page
    verdicts = ("not found again", "found again with", "replicated")
    order = [page.index(f"<td>{text}") for text in verdicts]
    assert order == sorted(order)
    assert "&lt;b&gt;.mcap" in page
    assert "8 of 12" in page
    for fetched in ("<script", "src=", "<link", "@import"):
        assert fetched not in page


def test_the_odd_unit_has_its_name_in_the_picture(lot: Lot) -> None:
    assert ODD in distribution_picture(lot, "dps", findings(lot)).svg()
    assert ODD not in distribution_picture(lot, "g", findings(lot)).svg()


def test_a_history_takes_repeats(lot: Lot) -> None:
    assert history_picture(lot, "dps") is not None
    once = [f"/lot/unit-{number:02d}/{number % RUNS}.mcap" for number in range(UNITS)]
    assert history_picture(lot.where(np.isin(lot["recording"].astype(str), once)), "dps") is None


def test_a_page_of_one_recording_says_what_it_cannot_say(lot: Lot) -> None:
    page = render_lot(lot.where(lot["recording"] == "/lot/unit-00/0.mcap"), {})
    assert "No unit has more than one run" in page
    assert "Not determined: this needs several runs" in page


def test_a_half_written_table_is_never_seen(tmp_path: Path) -> None:
    def failing() -> Any:
        yield rows()[0]
        raise OSError(28, "No space left on device")

    table = tmp_path / "lot.parquet"
    with pytest.raises(Exception, match="No space left"):
        write_table(table, failing())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("found", [1, 2])
def test_a_coefficient_of_which_most_units_have_a_limit_alone_is_no_error(found):
    names = np.array(list("abcdefghi"))
    value = np.where(np.arange(9) < found, 10.0, 0.0)
    sigma = np.where(np.arange(9) < found, 1.0, 1.5)
    units = UnitEstimates(names, value, sigma, value > 0.0, 0.0)
    assert outlying_units(units, 1) == []


def of_origins(lot: Lot, *origins: str | None) -> Lot:
    """Return as many recordings as there are origins."""
    names = np.unique(lot["recording"].astype(str))[: len(origins)]
    known = dict(zip(names, origins, strict=True))
    told = np.array([*(known.get(one) for one in lot["recording"]), None], object)[:-1]
    some = np.isin(lot["recording"].astype(str), names)
    return Lot({**lot.columns, "origin": told}).where(some)


def test_a_lot_that_was_simulated_says_so_above_everything(lot: Lot) -> None:
    why = "a program computed the samples; no part was measured"
    whole = of_origins(lot, "synthetic", "synthetic")
    pages: dict[str, str] = {}
    page = render_lot(whole, {}, put_page=pages.__setitem__)
    assert f'<p class="banner">Simulated data: {why}</p>' in page
    assert pages
    assert all(f'<p class="banner">Simulated data: {why}</p>' in one for one in pages.values())
    some = of_origins(lot, "synthetic", "measured", None, "emulated")
    banner = f"Simulated data in 2 of 4 recordings: {why}; the device is emulated; no part was"
    assert simulation_banner(some).startswith(banner)


@pytest.mark.parametrize("origins", [("measured", None), ("", "measured")])
def test_a_lot_that_was_measured_has_no_banner(lot: Lot, origins: tuple[str | None, ...]) -> None:
    assert '<p class="banner"' not in render_lot(of_origins(lot, *origins), {})


def test_the_table_keeps_the_origin_and_may_be_of_a_version_that_did_not(tmp_path: Path) -> None:
    table, earlier = tmp_path / "lot.parquet", tmp_path / "earlier.parquet"
    write_table(table, [row | {"origin": "synthetic"} for row in rows()[:4]])
    assert simulation_banner(Lot.read(table))
    pq.write_table(pq.read_table(table).drop_columns(["origin"]), earlier)
    assert not simulation_banner(Lot.read(earlier))
