"""Real logs and consoles, where they are at hand."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from allanscope.samples import Block, Event, Gap, StreamInfo
from allanscope.wire import WireSettings, format_named, sniff

RECORDINGS = Path(__file__).parents[3] / "shared" / "recordings"
pytestmark = pytest.mark.skipif(not RECORDINGS.is_dir(), reason="the recordings are not at hand")

LOGS = RECORDINGS / "st_mlc_bsd3_stationary"
CONSOLES = RECORDINGS / "lsm6ds3trc_hil_serial"
SETTINGS = WireSettings(part="LSM6DSL", gyro_fs=250.0, accel_fs=2.0)


def _events(path: Path) -> tuple[list[Event], bytes]:
    data = gzip.decompress(path.read_bytes())
    decoder = format_named("text").decoder(SETTINGS)
    return decoder.feed(data, 0.0) + decoder.finish(), data


@pytest.mark.parametrize(
    ("name", "rows", "axes", "rate"),
    [
        ("asm330lhhx_stationary1.csv.gz", 2300, 6, 0.0),
        ("asm330lhhx_vehicle_stationary.txt.gz", 4115, 6, 0.0),
        ("example3_stationary.csv.gz", 506, 3, 25.2),
        ("ism6hg256x_nailgun_stationary.csv.gz", 28398, 3, 0.0),
        ("lsm6dsox_still1.csv.gz", 874, 6, 52.0),
        ("lsm6dsox_still3.csv.gz", 831, 6, 52.0),
        ("lsm6dsv320x_still2.txt.gz", 766, 3, 0.0),
        ("lsm6dsv320x_still3.txt.gz", 780, 3, 0.0),
    ],
)
def test_every_row_of_a_log_is_read(name: str, rows: int, axes: int, rate: float) -> None:
    events, data = _events(LOGS / name)
    info = events[0]
    assert isinstance(info, StreamInfo)
    assert len(info.axes) == axes
    assert info.nominal_hz == pytest.approx(rate, rel=0.01)
    values = np.concatenate([event.counts for event in events if isinstance(event, Block)])
    assert len(values) == rows
    if "ax" in info.axes:
        force = np.linalg.norm(values[:, -3:].mean(axis=0))
        assert force == pytest.approx(1.0, abs=0.03)
    if "gx" in info.axes:
        assert np.abs(values[:, :3].mean(axis=0)).max() < 3.0
    assert sniff(data[:4000]).name == "text"


def test_a_log_gives_away_the_step_of_its_clock() -> None:
    coarse, fine = (
        _events(LOGS / name)[0][0]
        for name in ("lsm6dsox_still1.csv.gz", "example3_stationary.csv.gz")
    )
    assert isinstance(coarse, StreamInfo)
    assert isinstance(fine, StreamInfo)
    assert (coarse.time_resolution_s, fine.time_resolution_s) == (0.01, 1e-6)


def test_the_torn_row_of_a_log_is_a_hole() -> None:
    events, _ = _events(LOGS / "asm330lhhx_stationary1.csv.gz")
    assert [event for event in events if isinstance(event, Gap)] == [Gap("link", None)]
    assert isinstance(events[1], Block)
    assert len(events[1]) == 963


@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("20260622-earlyfail.txt.gz", 31),
        ("20260622-earlyfail2.txt.gz", 35),
        ("20260624-soak-10m.txt.gz", 69),
        ("20260624-soak-30m.txt.gz", 131),
    ],
)
def test_the_raw_rows_of_a_console_are_found(name: str, rows: int) -> None:
    events, data = _events(CONSOLES / name)
    assert data.count(b"Raw: ") == rows
    info = events[0]
    assert isinstance(info, StreamInfo)
    assert info.scale == (8.75e-3,) * 3 + (0.061e-3,) * 3
    blocks = [event for event in events if isinstance(event, Block)]
    counts = np.concatenate([block.counts for block in blocks])
    assert counts.shape == (rows, 6)
    assert counts.dtype == np.int16
    assert np.linalg.norm(counts[:, 3:].mean(axis=0)) * 0.061e-3 == pytest.approx(1.0, abs=0.05)
    warmth = np.concatenate([block.ticks.temperature_c for block in blocks])
    assert ((warmth > 20.0) & (warmth < 35.0)).all()
    assert sniff(data[:20_000]).name == "text"
