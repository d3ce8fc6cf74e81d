"""The measured recordings are what their README says, and may be passed on."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import welch

from allanscope.explain.series import series_of, why_not_searched
from allanscope.noise.gap_bridging import bridge_gaps
from allanscope.pipeline.table_files import table_of_file
from support.thinned import RATE, thinned

FOLDER = Path(__file__).parents[2] / "recordings" / "measured"
README = (FOLDER / "README.md").read_text(encoding="utf-8")
ROWS = {
    name: (axes, int(rows), rate, licence)
    for name, axes, rows, rate, licence in re.findall(
        r"^\| `(\S+)` \| [^|]+ \| ([^|]+) \| (\d+) \| ([^|]+) \| .*\]\((licences/\S+)\) \|$",
        README,
        re.M,
    )
}


def test_every_file_has_a_row_a_story_and_a_licence():
    assert {path.stem for path in FOLDER.glob("*.parquet")} == set(ROWS)
    for name, (_, _, _, licence) in ROWS.items():
        assert f"**`{name}`**" in README
        assert "opyright" in (FOLDER / licence).read_text(encoding="utf-8")
    used = {licence for *_, licence in ROWS.values()}
    assert {f"licences/{path.name}" for path in (FOLDER / "licences").iterdir()} == used


def test_the_files_are_small():
    sizes = [path.stat().st_size for path in FOLDER.rglob("*") if path.is_file()]
    assert max(sizes) < 5e6
    assert sum(sizes) < 25e6


@pytest.mark.parametrize("name", ROWS)
def test_a_recording_has_the_rows_axes_and_rate_of_its_row(name):
    axes, rows, rate, _ = ROWS[name]
    found = table_of_file(FOLDER / f"{name}.parquet")
    columns = found.columns
    said = int(match[0]) if (match := re.match(r"\d", axes)) else len(axes.split())
    assert len(columns.axes) == said
    assert {len(values) for values in columns.axes.values()} == {rows}
    if rate.startswith("times"):
        assert columns.time_s is not None
        assert columns.time_s[0] == 0.0
        assert np.all(np.diff(columns.time_s) > 0)
        period = np.median(np.diff(columns.time_s))
        assert 1.0 / period == pytest.approx(float(re.search(r"[\d.]+", rate)[0]), rel=0.02)
    else:
        assert found.rate_hz == pytest.approx(float(rate.split()[0]), rel=1e-9)
    for axis, values in columns.axes.items():
        if columns.units[axis] == "lsb":
            assert values.dtype.kind == "i"
            assert columns.scales[axis] > 0


def test_a_record_with_every_eighth_row_missing_has_the_density_of_its_rows():
    """N as `benchmarks/independent_reading.py` reads it."""
    read = {"gx": 5.41e-3, "gy": 6.62e-3, "gz": 6.07e-3, "ax": 74.5e-6, "ay": 60.9e-6}
    columns = table_of_file(FOLDER / "lsm6ds3-nano33iot.parquet").columns
    rows = np.concatenate([[0], np.cumsum(np.rint(np.diff(columns.time_s) * RATE))]).astype(int)
    grid = np.zeros((rows[-1] + 1, len(columns.axes)))
    grid[rows] = np.column_stack([v * columns.scales[axis] for axis, v in columns.axes.items()])
    kept = np.zeros(len(grid), bool)
    kept[rows] = True
    record = bridge_gaps(thinned(grid, kept))
    assert record.segments.tolist() == [[0, len(grid)]]
    assert record.filled.mean() == pytest.approx(0.13, abs=0.005)
    series = series_of(record)
    for axis, n in read.items():
        assert why_not_searched(series, axis) == ()
        f, density = welch(
            series.values[:, series.column(axis)], RATE, nperseg=2048, average="median"
        )
        flat = np.median(density[(f > 0.3) & (f < 9)]) / 0.979
        assert np.sqrt(flat / 2) == pytest.approx(n, rel=0.03), axis
