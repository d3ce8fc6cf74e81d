"""Several sessions on one page."""

import re
import statistics
from dataclasses import replace

import numpy as np
import pytest

from allanscope import analyse
from allanscope.noise import Coefficient
from allanscope.report import comparing_pictures, render_comparison
from allanscope.report.compare import _separation_tables
from support.report_session import two_axes

N = {"one": 2.8e-3, "two": 3.0e-3, "<three>": 3.2e-3}
SIGMA = 0.1e-3


def unit(seed, value):
    """Return the result of one unit with a given N of gx."""
    whole = replace(two_axes(seed=seed), record=None)
    low, high = value - 1.96 * SIGMA, value + 1.96 * SIGMA
    known = {
        **whole.axes["gx"].coefficients,
        "N": Coefficient(value, low, high, "dps/sqrt(Hz)", True),
    }
    return replace(whole, axes={**whole.axes, "gx": replace(whole.axes["gx"], coefficients=known)})


@pytest.fixture(scope="module")
def sessions():
    return {name: unit(seed, value) for seed, (name, value) in enumerate(N.items())}


@pytest.fixture(scope="module")
def page(sessions):
    return render_comparison(sessions)


def test_every_session_is_judged_and_named_safely(page):
    assert page.count('class="verdict ') == 3
    assert "<three>" not in page
    assert page.count("&lt;three&gt;") >= 5


def test_each_axis_has_an_overlay_and_a_table(page, sessions):
    assert page.count("<svg") == 2
    assert list(comparing_pictures(sessions)) == ["gx-comparison", "ax-comparison"]
    for value in N.values():
        assert f"{1e3 * value:.2f} [" in page


def test_the_spread_stands_beside_what_chance_alone_would_make(page):
    row = page[page.index("spread between sessions") :]
    first = re.search(r"<td>([\d.]+) % \(by chance ([\d.]+) %\)</td>", row)
    mean = statistics.mean(N.values())
    assert float(first[1]) == pytest.approx(100 * statistics.stdev(N.values()) / mean, rel=0.05)
    assert float(first[2]) == pytest.approx(100 * SIGMA / mean, rel=0.05)


def test_an_axis_that_only_one_session_has_is_shown_without_a_spread(sessions):
    first, second, _ = sessions.values()
    page = render_comparison({"a": first, "b": replace(second, axes={"ax": second.axes["ax"]})})
    gx = page[page.index("<h2>gx") : page.index("<h2>ax")]
    assert gx.count("<td>–</td>") == 3
    assert "<th>b</th>" not in gx


SIGMAS = {"A": 0.02, "B": 0.05, "C": 0.1}
"""White noise of three units, in dps a sample."""


@pytest.fixture(scope="module")
def bench():
    """Results of three units on one bench that moves by more than any of them is noisy."""
    rng = np.random.default_rng(3)
    shake = np.convolve(rng.normal(size=9019), np.ones(20) / 20, "valid")  # up to 3 Hz
    return {
        name: analyse({"gx[dps]": shake + sigma * rng.normal(size=9000)}, rate=100.0)
        for name, sigma in SIGMAS.items()
    }


def begun(units, *days):
    return {
        name: replace(one, input={**one.input, "started": f"2026-01-{day:02}T10:00:00+00:00"})
        for (name, one), day in zip(units.items(), days, strict=True)
    }


def test_three_units_recorded_at_once_are_told_apart(bench):
    """The hat of three: what each has alone is its white noise, sigma / sqrt(m)."""
    units = begun(bench, 1, 1, 1)
    assert "<summary>Recorded together" in render_comparison(units)
    (table,) = _separation_tables(units)
    assert table.heads == ["τ, s", "common", "A alone", "B alone", "C alone"]
    assert len(table.rows) >= 3
    for row in table.rows:
        m = round(float(row[0]) * 100.0)
        for cell, sigma in zip(row[2:], SIGMAS.values(), strict=True):
            truth = 1e3 * sigma / np.sqrt(m)
            if cell.startswith("<"):
                assert float(cell[2:]) > truth
                continue
            lower, upper = map(float, cell.split("[")[1].rstrip("]").split(", "))
            assert 0.9 * lower < truth < 1.1 * upper, (row[0], cell)


def test_units_that_were_not_recorded_at_once_are_not_told_apart(bench):
    units = begun(bench, 1, 2, 3)
    assert not _separation_tables(units)
    assert "Recorded together" not in render_comparison(units)
    assert not _separation_tables(dict(list(begun(bench, 1, 1, 1).items())[:2]))
    assert not _separation_tables(bench)  # arrays do not say when they began
