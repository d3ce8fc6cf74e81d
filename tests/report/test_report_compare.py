"""Several sessions on one page."""

import re
import statistics
from dataclasses import replace

import pytest

from allanscope.noise import Coefficient
from allanscope.report import comparing_pictures, render_comparison
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
