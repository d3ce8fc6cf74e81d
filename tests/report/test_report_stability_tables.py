"""The fold of what stands beside deviations: every number against allantools or a closed form."""

from dataclasses import replace

import allantools
import numpy as np
import pytest

from allanscope import analyse
from allanscope.report import render
from allanscope.report.stability_tables import stability_tables

HZ, SAMPLES = 50.0, 6000
RNG = np.random.default_rng(5)
SHARED = RNG.normal(size=SAMPLES)
SIGMA = 0.02
RATES = {
    "gx[dps]": SIGMA * (SHARED + 0.5 * RNG.normal(size=SAMPLES)),
    "gy[dps]": SIGMA * (SHARED + 0.5 * RNG.normal(size=SAMPLES)) + 0.3,
    "az[g]": 1.0 + 1e-3 * RNG.normal(size=SAMPLES),
}


@pytest.fixture(scope="module")
def analysis():
    return analyse(RATES, rate=HZ)


@pytest.fixture(scope="module")
def tables(analysis):
    """Tables by the first words of their captions."""
    return {one.caption.split(" of ")[0].split(",")[0]: one for one in stability_tables(analysis)}


def column(table, name, part):
    """Return one of the two numbers in the cells of a column, where there are two."""
    i = table.heads.index(name)
    cells = [row[i].split(", ") for row in table.rows]
    return [float(cell[part].removesuffix(" %")) for cell in cells if len(cell) > part]


def test_time_errors_are_those_of_allantools(tables):
    """Three digits, of the angle in deg without the mean rate."""
    table = tables["Gyroscope: change"]
    m = [1, 4, 16, 64, 256]
    assert [float(row[0]) for row in table.rows] == pytest.approx(np.array(m) / HZ, rel=5e-3)
    rates = RATES["gy[dps]"]
    phase = np.append(0.0, np.cumsum(rates - rates.mean())) / HZ
    for part, theirs in enumerate((allantools.mtie, allantools.tierms)):
        _, expected, _, _ = theirs(phase, rate=1.0, taus=m)
        assert column(table, "gy", part) == pytest.approx(expected, rel=5e-3)


def test_velocity_is_in_m_per_s(tables):
    one = tables["Accelerometer: change"]
    assert "in m/s" in one.caption
    expected = 9.80665 * np.std(RATES["az[g]"]) / HZ  # TIE rms of one sample
    assert column(one, "az", 1)[0] == pytest.approx(expected, rel=1e-2)


def test_codeviations_are_those_of_allantools(tables):
    table = tables["Gyroscope: Groslambert codeviation"]
    phases = [np.append(0.0, np.cumsum(RATES[k])) / HZ for k in ("gx[dps]", "gy[dps]")]
    m = np.array([1, 4, 16, 64, 256])
    _, expected, _, _ = allantools.gcodev(*phases, rate=HZ, taus=m / HZ)
    assert column(table, "gx gy", 0) == pytest.approx(1e3 * expected, rel=5e-3)
    assert column(table, "gx gy", 0)[:3] == pytest.approx(1e3 * SIGMA / np.sqrt(m[:3]), rel=0.1)
    assert not any("Accelerometer: Groslambert" in name for name in tables)  # one axis alone


def test_a_line_through_white_noise_gives_its_level(tables):
    rows = {row[0]: row for row in tables["Accelerometer: AVLR"].rows}
    value, limits = rows["az N"][2].split(" [")
    lower, upper = (float(x) for x in limits.split("]")[0].split(", "))
    assert lower < 1e3 / np.sqrt(HZ) < upper  # 1 mg a sample, in ug/sqrt(Hz)
    assert value in rows["az N"][2]


def test_the_sampling_error_is_that_of_degrees_of_freedom(tables):
    """Of a deviation 1 / sqrt(2 edf): 2 n / 3 degrees at m = 1 of white noise."""
    table = tables["Gyroscope: sampling error"]
    errors = column(table, "gx", 0)
    assert errors[0] == pytest.approx(100 / np.sqrt(2 * 2 / 3 * SAMPLES), rel=0.05)
    edf = allantools.edf_greenhall(0, 2, 64, SAMPLES + 1, overlapping=True, modified=False)
    assert errors[3] == pytest.approx(100 / np.sqrt(2 * edf), rel=0.1)
    assert all(0.1 < r < 0.4 for r in column(table, "gx", 1))


def test_the_fold_is_on_the_page_and_closed(analysis):
    page = render(analysis)
    assert '<details class="more"><summary>Other statistics: MTIE' in page
    assert "Groslambert codeviation of two axes" in page
    assert "|H(f)|²" in page
    assert '<details class="more" open><summary>Other statistics' in render(analysis, full=True)


def test_without_samples_only_what_needs_none_is_there(analysis):
    captions = [one.caption for one in stability_tables(replace(analysis, record=None))]
    assert captions
    assert all("AVLR" in one or "sampling error" in one for one in captions)
