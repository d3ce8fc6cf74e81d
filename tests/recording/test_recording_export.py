"""Exports: what was decoded, in the words that the text reader of this program understands."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from allanscope.errors import InputError, UsageError
from allanscope.recording import export_csv, export_parquet
from allanscope.samples import Block, Event, Gap, Notice, StreamInfo, Ticks

INFO = StreamInfo(
    ("gx", "az"), (0.004375, 0.000061), nominal_hz=100.0, part="LSM6DSL", wire="native"
)


def block(index: int, n: int, temperature: dict[int, float] | None = None) -> Block:
    counts = (np.arange(index * 2, (index + n) * 2) % 2001 - 1000).astype(np.int16).reshape(n, 2)
    at = np.array(sorted(temperature or {}), np.int64)
    nothing = np.full(len(at), np.nan)
    told = np.array([(temperature or {})[k] for k in at.tolist()])
    return Block(index, counts, Ticks(at, nothing, nothing, told))


def columns(path: Path) -> dict[str, np.ndarray]:
    head, *rows = path.read_text().splitlines()
    values = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    return dict(zip(head.split(","), values.T, strict=True))


def test_text_holds_times_axes_and_units(tmp_path: Path) -> None:
    events: list[Event] = [INFO, block(0, 30), Notice("text", "hello"), block(30, 20)]
    report = export_csv(events, tmp_path / "a.csv")
    table = columns(tmp_path / "a.csv")
    assert list(table) == ["t[s]", "gx[dps]", "az[g]"]
    np.testing.assert_allclose(table["t[s]"], np.arange(50) / 100.0, atol=1e-9)
    counts = np.concatenate([block(0, 30).counts, block(30, 20).counts])
    np.testing.assert_allclose(table["gx[dps]"], counts[:, 0] * 0.004375, rtol=1e-8)
    assert (report.rows, report.gaps) == (50, 0)


def test_counts_are_exact(tmp_path: Path) -> None:
    export_csv([INFO, block(0, 30)], tmp_path / "a.csv", unit="lsb")
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert lines[:2] == ["t[s],gx[lsb],az[lsb]", "0.000000000,-1000,-999"]


def test_the_measured_rate_makes_the_times(tmp_path: Path) -> None:
    export_csv([INFO, block(0, 11)], tmp_path / "a.csv", rate_hz=96.0)
    assert columns(tmp_path / "a.csv")["t[s]"][-1] == pytest.approx(10 / 96.0)


def test_a_hole_of_known_length_is_a_jump_in_time(tmp_path: Path) -> None:
    report = export_csv([INFO, block(5, 10), Gap("link", 7), block(22, 3)], tmp_path / "a.csv")
    np.testing.assert_allclose(
        columns(tmp_path / "a.csv")["t[s]"], [*np.arange(10) / 100, 0.17, 0.18, 0.19], atol=1e-9
    )
    assert (report.gaps, report.unknown_gaps) == (1, 0)


def test_a_hole_of_unknown_length_never_joins_its_two_sides(tmp_path: Path) -> None:
    report = export_csv([INFO, block(0, 10), Gap("link", None), block(10, 2)], tmp_path / "a.csv")
    assert np.diff(columns(tmp_path / "a.csv")["t[s]"]).max() == pytest.approx(0.02)
    assert report.unknown_gaps == 1


def test_a_restart_goes_on_in_time_and_joins_nothing(tmp_path: Path) -> None:
    events: list[Event] = [INFO, block(1000, 10), Gap("restarted", None), INFO, block(0, 2)]
    export_csv(events, tmp_path / "a.csv")
    steps = np.diff(columns(tmp_path / "a.csv")["t[s]"])
    assert steps.min() > 0
    assert steps[9] == pytest.approx(0.02)


def test_temperature_is_held_between_ticks(tmp_path: Path) -> None:
    export_csv([INFO, block(0, 6, {2: 25.0, 4: 25.5}), block(6, 2)], tmp_path / "a.csv")
    assert columns(tmp_path / "a.csv")["temp[degC]"].tolist() == [25, 25, 25, 25] + [25.5] * 4


def test_other_axes_on_the_way_are_refused_and_leave_no_file(tmp_path: Path) -> None:
    other = StreamInfo(("gx",), (0.004375,), nominal_hz=100.0)
    with pytest.raises(InputError, match="axes change"):
        export_csv([INFO, block(0, 3), other], tmp_path / "a.csv")
    rescaled = StreamInfo(("gx", "az"), (0.00875, 0.000061), nominal_hz=100.0)
    with pytest.raises(InputError, match="scale changes"):
        export_csv([INFO, block(0, 3), rescaled], tmp_path / "a.csv", unit="lsb")
    assert list(tmp_path.iterdir()) == []


def test_no_rate_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--rate"):
        export_csv([StreamInfo(("gx",), (1.0,)), block(0, 3)], tmp_path / "a.csv")
    with pytest.raises(UsageError, match="cannot write"):
        export_csv([INFO, block(0, 3)], tmp_path / "nowhere" / "a.csv")


def many() -> Iterator[Event]:
    yield INFO
    for index in range(0, 1000, 10):
        yield block(index, 10)


def test_parquet_holds_the_same_and_says_what_it_means(tmp_path: Path) -> None:
    report = export_parquet(many(), tmp_path / "a.parquet", unit="lsb")
    table = pq.read_table(tmp_path / "a.parquet")
    assert table.column_names == ["t[s]", "gx[lsb]", "az[lsb]"]
    assert str(table.schema.field("gx[lsb]").type) == "int16"
    assert table["gx[lsb]"].to_pylist() == block(0, 1000).counts[:, 0].tolist()
    facts = json.loads(table.schema.metadata[b"allanscope"])
    assert (facts["scale"], facts["part"]) == ([0.004375, 0.000061], "LSM6DSL")
    assert report.rows == 1000
    assert pq.ParquetFile(tmp_path / "a.parquet").num_row_groups == 1


def test_parquet_of_nothing_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no samples"):
        export_parquet([INFO], tmp_path / "a.parquet")
    assert list(tmp_path.iterdir()) == []
