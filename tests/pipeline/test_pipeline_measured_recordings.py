"""The measured recordings are what their README says, and may be passed on."""

import re
from pathlib import Path

import numpy as np
import pytest

from allanscope.pipeline.table_files import table_of_file

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
