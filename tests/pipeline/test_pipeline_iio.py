"""A sensor of Linux IIO by the command line: live, and as iio_readdev recorded it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.errors import InputError
from allanscope.pipeline.table_files import table_of_file
from allanscope.sources.iio import devices
from support.iio_tree import Driver, make_device, scans

N = 4000
RATE = 106.3
RNG = np.random.default_rng(9)
GYRO = RNG.normal(0, 6, (N, 3)).round().astype(np.int64)
ACCEL = RNG.normal((0, 0, 16393), 12, (N, 3)).round().astype(np.int64)
TIMES = 1_790_000_000_000_000_000 + np.rint(np.arange(N) / RATE * 1e9).astype(np.int64)
HEAD = (
    '<?xml version="1.0" encoding="utf-8"?><!DOCTYPE context [<!ELEMENT context (device | '
    "context-attribute)*><!ATTLIST scan-element index CDATA #REQUIRED format CDATA #REQUIRED>]>"
    '<context name="local" description="Linux">'
)


def device(number: int, name: str, kind: str, scale: str, old: bool = True) -> str:
    """Return what libiio says of a device: the scale where version 0 has it, or version 1."""
    in_scan, beside = (f' scale="{scale}"', "") if old else ("", f' value="{scale}"')
    channels = "".join(
        f'<channel id="{kind}_{axis}" type="input"><scan-element index="{i}" '
        f'format="le:S16/16&gt;&gt;0"{in_scan} /><attribute name="scale" '
        f'filename="in_{kind}_scale"{beside} /></channel>'
        for i, axis in enumerate("xyz")
    )
    return (
        f'<device id="iio:device{number}" name="{name}">{channels}<channel id="timestamp" '
        'type="input"><scan-element index="3" format="le:S64/64&gt;&gt;0" /></channel>'
        '<attribute name="sampling_frequency" /></device>'
    )


def context(old: bool = True) -> str:
    gyro = device(1, "lsm6dsm_gyro", "anglvel", "0.000152716", old)
    return HEAD + gyro + device(2, "lsm6dsm_accel", "accel", "0.000598", old) + "</context>"


def record(path: Path, kept: np.ndarray | None = None, xml: str = "") -> Path:
    """Write a folder as the two commands of libiio do."""
    path.mkdir()
    (path / "context.xml").write_text(xml or context())
    kept = np.ones(N, bool) if kept is None else kept
    (path / "lsm6dsm_gyro.bin").write_bytes(b"".join(scans(GYRO[kept], TIMES[kept])))
    (path / "lsm6dsm_accel.bin").write_bytes(b"".join(scans(ACCEL, TIMES + 30_000)) + b"cut")
    return path


@pytest.mark.parametrize("old", [True, False])
def test_what_iio_readdev_wrote_comes_back(tmp_path, old):
    table = table_of_file(record(tmp_path / "a", xml=context(old)))
    rows = np.column_stack(list(table.columns.axes.values()))
    assert np.array_equal(rows, np.column_stack([GYRO, ACCEL]))
    assert table.part == "LSM6DSM"
    assert dict(table.columns.scales)["gz"] == 8.75e-3
    assert dict(table.columns.scales)["ax"] == 0.061e-3
    assert table.columns.time_s is not None
    assert np.abs(table.columns.time_s - np.arange(N) / RATE).max() < 2e-9


def test_a_recorded_folder_is_analysed_with_its_losses(tmp_path, capsys):
    kept = np.ones(N, bool)
    kept[1000:1007] = False
    folder = record(tmp_path / "a", kept)
    assert main(["analyse", str(folder), "--json", "-", "--quiet", "--kinds", "oadev"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["part"] == "LSM6DSM"
    assert (result["samples"], result["lost_samples"]) == (N - 7, 7)
    assert result["rate"]["measured_hz"] == pytest.approx(RATE, rel=1e-4)
    N_gx = result["axes"]["gx"]["coefficients"]["N"]["value"]
    assert N_gx == pytest.approx(6 * 8.75e-3 / np.sqrt(RATE), rel=0.05)


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        (HEAD, "context.xml: no element found"),
        (context().replace("lsm6dsm_", "other_"), "no file with the scans of a device"),
        (context().replace('index="0"', 'index="9"').replace("S16", "S33"), "not possible"),
        (context().replace("timestamp", "time"), "has no timestamp"),
        (context().replace("scale", "scala"), "no scale of anglvel_x"),
        (context().replace("<!ELEMENT", "<!ENTITY a 'b'><!ELEMENT"), "not what iio_genxml"),
        (context().replace("S16/16", "S32/32"), "record all channels of lsm6dsm_gyro"),
    ],
)
def test_what_cannot_be_read_is_said(tmp_path, xml, message):
    folder = record(tmp_path / "a", xml=xml)
    with pytest.raises(InputError, match=message):
        table_of_file(folder)


@pytest.mark.skipif(sys.platform != "linux", reason="IIO is of Linux")
@pytest.mark.usefixtures("undrawn")
def test_live_records_what_the_buffers_give_and_a_replay_is_the_same(tmp_path, monkeypatch):
    monkeypatch.setattr(devices, "SYSFS", tmp_path / "sys")
    monkeypatch.setattr(devices, "DEV", tmp_path / "dev")
    make_device(tmp_path, 0, "accel")
    make_device(tmp_path, 1, "gyro")
    out = tmp_path / "out"
    streams = {0: scans(ACCEL, TIMES), 1: scans(GYRO, TIMES)}
    asked = ["--for", "4s", "--gyro-fs", "250", "--view", "none", "--out", str(out), "--quiet"]
    with Driver(tmp_path, streams, burst=20, pause_s=0.01):
        assert main(["live", "iio:lsm6dsm", *asked]) == 0
    result = json.loads((out / "result.json").read_text())
    assert result["input"]["name"] == "iio:lsm6dsm"
    assert result["part"] == "LSM6DSM"
    assert result["origin"] == "measured"
    assert result["lost_samples"] == 0
    assert result["samples"] > 200
    again = tmp_path / "again.json"
    assert main(["analyse", str(out), "--json", str(again), "--quiet"]) == 0
    assert json.loads(again.read_text())["samples"] == result["samples"]
