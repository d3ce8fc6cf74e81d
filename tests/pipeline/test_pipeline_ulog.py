"""Logs of PX4 give the samples that were logged."""

from __future__ import annotations

import builtins
import json
import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.errors import InputError, UsageError
from allanscope.pipeline.table_files import table_of_file

pytest.importorskip("pyulog", reason="pyulog is not installed")

N, STEP_US = 3000, 4000
RNG = np.random.default_rng(6)
GYRO = RNG.normal(0, 1e-3, (N, 3)).astype(np.float32)
ACCEL = RNG.normal((0, 0, 9.81), 0.02, (N, 3)).astype(np.float32)
COMBINED = "sensor_combined:uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;"
SENSOR = "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;"
Topic = tuple[str, int, list[bytes]]


def write(path: Path, formats: list[str], topics: list[Topic]) -> Path:
    """Write a ULog by its published layout: header, formats, subscriptions, data."""

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<H", len(body)) + kind + body

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    out += message(b"B", bytes(40))
    for one in formats:
        out += message(b"F", one.encode())
    for number, (name, which, _) in enumerate(topics):
        out += message(b"A", struct.pack("<BH", which, number) + name.encode())
    for number, (_, _, rows) in enumerate(topics):
        for row in rows:
            out += message(b"D", struct.pack("<H", number) + row)
    path.write_bytes(out)
    return path


def combined(rows: int = N) -> list[bytes]:
    return [
        struct.pack("<Q6f", 10_000_000 + i * STEP_US, *GYRO[i].tolist(), *ACCEL[i].tolist())
        for i in range(rows)
    ]


def sensor(values: np.ndarray, late_us: int = 0, step: int = 1) -> list[bytes]:
    return [
        struct.pack("<QQI3f", 9 + at, at, 77, *values[i].tolist())
        for i in range(0, len(values), step)
        for at in [10_000_000 + i * STEP_US + late_us]
    ]


def rows(path: Path, stream: str = "") -> tuple[list[str], np.ndarray, tuple[str, ...]]:
    columns = table_of_file(path, stream).columns
    assert columns.time_s is not None
    assert np.abs(columns.time_s - np.arange(len(columns.time_s)) * STEP_US * 1e-6).max() < 1e-9
    return list(columns.axes), np.column_stack(list(columns.axes.values())), columns.assumed


def test_the_combined_topic_is_analysed(tmp_path, capsys):
    path = write(tmp_path / "a.ulg", [COMBINED], [("sensor_combined", 0, combined())])
    assert main(["analyse", str(path), "--json", "-", "--quiet", "--kinds", "oadev"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["samples"] == N
    assert result["rate"]["measured_hz"] == pytest.approx(250.0)
    found = result["axes"]["gx"]["coefficients"]["N"]["value"]
    assert found == pytest.approx(np.rad2deg(1e-3) / np.sqrt(250.0), rel=0.05)
    assert result["axes"]["az"]["unit"] == "g"


def test_a_gyroscope_and_the_accelerometer_of_its_number(tmp_path):
    formats = [f"sensor_gyro:{SENSOR}", f"sensor_accel:{SENSOR}"]
    topics: list[Topic] = [
        ("sensor_gyro", 0, sensor(GYRO[:100])),
        ("sensor_gyro", 1, sensor(GYRO)),
        ("sensor_accel", 1, sensor(ACCEL, 900)),
    ]
    path = write(tmp_path / "a.ulg", formats, topics)
    axes, values, said = rows(path)
    assert axes == ["gx", "gy", "gz", "ax", "ay", "az"]
    assert np.array_equal(values, np.hstack([GYRO, ACCEL]))
    assert said == ("the topic is sensor_gyro 1; --stream selects another: sensor_gyro 0",)
    axes, values, _ = rows(path, "sensor_gyro")
    assert axes == ["gx", "gy", "gz"]
    assert np.array_equal(values, GYRO[:100])


def test_an_accelerometer_of_other_times_is_left_out(tmp_path):
    formats = [f"sensor_gyro:{SENSOR}", f"sensor_accel:{SENSOR}"]
    topics: list[Topic] = [
        ("sensor_gyro", 0, sensor(GYRO)),
        ("sensor_accel", 0, sensor(ACCEL, 0, 2)),
    ]
    axes, _, said = rows(write(tmp_path / "a.ulg", formats, topics))
    assert axes == ["gx", "gy", "gz"]
    assert "sensor_accel 0 is ignored: its rows have other times" in said


def test_what_cannot_be_read_is_said(tmp_path, monkeypatch):
    path = write(tmp_path / "a.ulg", [COMBINED], [("sensor_combined", 0, combined(5))])
    with pytest.raises(InputError, match="no topic sensor_gyro; there is sensor_combined 0"):
        table_of_file(path, "sensor_gyro")
    other = write(tmp_path / "b.ulg", ["baro:uint64_t timestamp;float p;"], [("baro", 0, [])])
    with pytest.raises(InputError, match="no topic of sensor_combined"):
        table_of_file(other)
    whole = path.read_bytes()
    for length in range(16, len(whole), 37):
        path.write_bytes(whole[:length])
        with suppress(InputError):  # nothing else
            table_of_file(path)
    real = builtins.__import__

    def without(name, *rest):
        if name == "pyulog":
            raise ImportError
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UsageError, match="pip install pyulog"):
        table_of_file(path)
