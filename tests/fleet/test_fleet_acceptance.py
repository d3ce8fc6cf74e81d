"""A lot against limits and against another lot; the pages of units; a table in parts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from allanscope.errors import UsageError
from allanscope.fleet.acceptance import accept, clopper_pearson
from allanscope.fleet.comparison import differences
from allanscope.fleet.lot import Lot, rows_of, schema, write_table
from allanscope.fleet.page import STAGES, render_lot
from allanscope.fleet.unit_pages import MOST_PICTURES, page_name
from allanscope.pipeline.check import compare
from support.demo_analysis import demo_analysis

UNITS = 12


def row(unit: str, run: int, axis: str, n: float, **more: Any) -> dict[str, Any]:
    """Return a row of which N is well known and B is not seen."""
    known: dict[str, Any] = dict.fromkeys(schema().names)
    known |= {"recording": f"/lot/{unit}/{run}.mcap", "unit": unit, "axis": axis}
    known |= {"sensor_unit": "dps" if axis.startswith("g") else "g", "part": "LSM6DSM"}
    known |= {"duration_s": 600.0, "samples": 60_000, "lost_samples": 0, "damaged_places": 0}
    known |= {"N_value": n, "N_lower": 0.98 * n, "N_upper": 1.02 * n, "N_detected": True}
    known |= {"B_value": 1e-4, "B_lower": 0.0, "B_upper": 1e-3, "B_detected": False}
    known |= {"level_mean": 0.1, "measured_hz": 104.0, "nominal_hz": 104.0}
    known |= {"rate_uncertainty_ppm": 5.0, "explained": True, "effects": [], "remarks": []}
    return known | more


def lot_of(path: Path, rows: list[dict[str, Any]], *partition: str) -> Lot:
    write_table(path, rows, partition)
    return Lot.read(path, limits=True)


def rows(times: float = 1.0, seed: int = 1) -> list[dict[str, Any]]:
    rng = np.random.default_rng(seed)
    return [
        row(f"unit-{number:02d}", run, axis, n * float(np.exp(0.05 * rng.standard_normal())))
        for number in range(UNITS)
        for run in range(2)
        for axis, n in (("gx", 0.004 * times), ("az", 9e-5))
    ]


def test_a_unit_is_accepted_when_all_of_its_runs_are(tmp_path: Path) -> None:
    known = rows()
    known[0] |= {"N_value": 0.0061, "N_lower": 0.0059, "N_upper": 0.0063}  # one run of unit-00
    known[4] |= {"N_value": 0.0059, "N_lower": 0.0057, "N_upper": 0.0061}  # unit-01: who knows
    known[11] |= {"N_value": None, "N_lower": None, "N_upper": None, "N_detected": None}
    told = accept(
        lot_of(tmp_path / "a", known),
        {"gx": {"N": {"max": 0.006}, "B": {"max": 1e-2}}, "az": {"N": {"min": 1e-5, "max": 1e-3}}},
    )
    assert {(one.unit, one.axis, one.quantity) for one in told.rejected} == {
        ("unit-00", "gx", "N"),
        ("unit-02", "az", "N"),
    }
    [of_n] = [one for one in told.counts if (one.axis, one.quantity) == ("gx", "N")]
    assert (of_n.met, of_n.missed, of_n.close) == (UNITS - 1, 1, 2)
    reasons = {one.unit: one.reason for one in told.rejected}
    assert reasons["unit-00"] == "N is 6.10 mdps/√Hz; max 6.00"
    assert "could not be measured" in reasons["unit-02"]
    assert told.words.startswith(f"10 of {UNITS} units accepted: 83.3 % [")


def test_what_was_not_seen_may_be_as_large_as_its_limit_or_nothing(tmp_path: Path) -> None:
    lot = lot_of(tmp_path / "a", rows())
    for bounds, bad in (({"max": 2e-3}, 0), ({"max": 5e-4}, UNITS), ({"min": 1e-6}, UNITS)):
        assert len(accept(lot, {"gx": {"B": bounds}}).names) == bad


def test_an_axis_that_is_absent_misses_its_limits(tmp_path: Path) -> None:
    told = accept(lot_of(tmp_path / "a", rows()[1:]), {"gy": {"N": {"max": 1.0}}})
    assert len(told.names) == UNITS
    assert {one.reason for one in told.rejected} == {"no run has this axis"}


def test_a_lot_of_one_is_judged_as_check_judges(tmp_path: Path) -> None:
    """Limits just below and above each value and upper limit."""
    analysis = demo_analysis(600.0)
    told = analysis.to_dict()
    told["input"]["sha256"] = ""
    kept = {"analysis": told, "circumstances": {}}
    lot = lot_of(tmp_path / "a", list(rows_of("a.mcap", "a", kept)))
    judged = 0
    for axis, known in analysis.axes.items():
        for name, one in known.coefficients.items():
            for at in (one.value, one.upper):
                for factor in (0.999, 1.001):
                    for side in ("min", "max"):
                        limits = {axis: {name: {side: factor * at}}}
                        [verdict] = compare(analysis, limits)
                        assert (not accept(lot, limits).rejected) == verdict.passed, limits
                        judged += 1
    assert judged > 100


@pytest.mark.parametrize(("good", "units"), [(0, 5), (5, 5), (3, 7), (990, 1000)])
def test_the_interval_of_the_yield_is_exact(good: int, units: int) -> None:
    exact = binomtest(good, units).proportion_ci(method="exact")
    assert clopper_pearson(good, units) == pytest.approx((exact.low, exact.high))


def test_lots_that_differ_are_told_to_and_by_how_much(tmp_path: Path) -> None:
    known = rows()
    for one in known[:4]:  # a unit that stands out is none of what is typical
        one["N_value"], one["N_lower"], one["N_upper"] = 0.04, 0.039, 0.041
    lot, other = lot_of(tmp_path / "a", known), lot_of(tmp_path / "b", rows(0.9, seed=2))
    [first, *rest] = differences(lot, other)
    assert (first.axis, first.quantity) == ("gx", "N")
    assert first.is_significant
    assert first.lower < 1.0 / 0.9 - 1.0 < first.upper
    assert not any(one.is_significant for one in rest)
    assert {one.quantity for one in rest} == {"N", "level", "rate"}
    page = render_lot(lot, {}, other=other, other_name="lot-b")
    assert "against lot-b:</b> N of gx differ; 4 quantities compared" in page


def test_lots_that_are_alike_seldom_differ() -> None:
    """At most one comparison in a hundred of two lots, all quantities together."""
    rng = np.random.default_rng(3)
    wrong, times = 0, 120
    for _ in range(times):
        lots = []
        for units in (6, 15):
            logs = 0.1 * rng.standard_normal((units, 2)) + 0.02 * rng.standard_normal((units, 2))
            values = np.exp(logs).T.ravel()
            names = np.tile([f"{u:02}" for u in range(units)], 2).astype(object)
            axes = np.repeat(np.array(["ax", "az"], object), units)
            wide = math.exp(1.96 * 0.02)
            columns = {"N_value": values, "N_lower": values / wide, "N_upper": values * wide}
            columns |= {"N_detected": np.ones(2 * units), "unit": names, "axis": axes}
            nothing = np.full(2 * units, np.nan)
            for name in "BK":
                columns |= {f"{name}_{p}": nothing for p in ("value", "lower", "upper", "detected")}
            columns |= {"recording": names, "nominal_hz": nothing, "measured_hz": nothing}
            lots.append(Lot({**columns, "rate_uncertainty_ppm": nothing}))
        wrong += any(one.is_significant for one in differences(*lots))
    assert wrong <= 5  # 1.2 expected; more than 5 have a probability of 0.002


def test_each_unit_of_the_report_has_a_page_of_its_own(tmp_path: Path) -> None:
    known = rows()
    for one in known[:4]:
        one["N_value"], one["N_lower"], one["N_upper"] = 0.04, 0.039, 0.041
    known[5]["unit"] = known[7]["unit"] = "<b>../x"
    pages: dict[str, str] = {}
    done: list[float] = []
    page = render_lot(
        lot_of(tmp_path / "a", known), {}, put_page=pages.__setitem__, advance=done.append
    )
    names = {one["unit"] for one in known}
    assert set(pages) == {page_name(unit) for unit in names}
    assert all("/" not in name and name.endswith(".html") for name in pages)
    for unit in names:
        assert page.count(f'href="units/{page_name(unit)}"') >= 1
    assert "<b>" not in page.split("<h2>Units</h2>")[1].replace("<b>sorted", "")
    assert "times that of the others" in pages["unit-00.html"]
    assert "does not stand out" in pages["unit-05.html"]
    assert pages["unit-05.html"].count("<tr>") > 4
    assert '"../lot.html"' in pages["unit-05.html"]
    assert sum(done) == pytest.approx(STAGES, abs=1)


def test_only_units_that_stand_out_have_a_picture(tmp_path: Path) -> None:
    tau_curve = np.geomspace(1e-2, 1e-3, 33).tolist()
    known = [{**one, "curve": tau_curve, "curve_edf": [50.0] * 33} for one in rows()]
    for one in known[:4]:
        one["N_value"], one["N_lower"], one["N_upper"] = 0.04, 0.039, 0.041
    pages: dict[str, str] = {}
    render_lot(lot_of(tmp_path / "a", known), {}, put_page=pages.__setitem__)
    assert [name for name, text in pages.items() if "<svg" in text] == ["unit-00.html"]
    assert MOST_PICTURES < 100


def test_a_table_in_parts_holds_the_same(tmp_path: Path) -> None:
    known = rows()
    known[3]["part"] = None
    known[5]["unit"] = "a/b c"
    whole = lot_of(tmp_path / "whole", known)
    parts = lot_of(tmp_path / "parts", known, "part", "axis")
    files = sorted(p.relative_to(tmp_path / "parts") for p in (tmp_path / "parts").rglob("*.*"))
    assert [str(one) for one in files] == [
        "part=LSM6DSM/axis=az/part-0.parquet",
        "part=LSM6DSM/axis=gx/part-0.parquet",
        "part=__HIVE_DEFAULT_PARTITION__/axis=az/part-0.parquet",
    ]

    def by_row(lot: Lot) -> dict[tuple[str, str], tuple[Any, ...]]:
        columns = ("recording", "axis", "unit", "part", "N_value", "B_upper")
        rows = zip(*(lot[name].tolist() for name in columns), strict=True)
        return {(one[0], one[1]): one for one in rows}

    assert by_row(parts) == by_row(whole)
    of_units = lot_of(tmp_path / "parts", known, "unit")  # in the place of what was there
    assert by_row(of_units) == by_row(whole)
    assert len(list((tmp_path / "parts").iterdir())) == UNITS + 1


def test_a_table_in_too_many_parts_is_refused_and_nothing_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("allanscope.fleet.lot.MOST_PARTS", 3)
    with pytest.raises(UsageError, match="more than 3 files"):
        write_table(tmp_path / "parts", rows(), ("unit",))
    assert list(tmp_path.iterdir()) == []
