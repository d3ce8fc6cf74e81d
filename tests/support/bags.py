"""Bags of ROS 2 as its recorders write them, made with mcap, sqlite3 and struct alone."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

IMU = "sensor_msgs/msg/Imu"
Message = tuple[str, int, bytes]
"""Topic, time at which it was written in ns, and its bytes."""


class Cdr:
    """Writes values one after the other, each at a multiple of its size after the four bytes."""

    def __init__(self, big: bool = False) -> None:
        self.order = ">" if big else "<"
        self.data = bytearray(b"\x00\x00\x00\x00" if big else b"\x00\x01\x00\x00")

    def put(self, kind: str, *values: float) -> Cdr:
        size = struct.calcsize(kind)
        for value in values:
            self.data += bytes(-(len(self.data) - 4) % size)
            self.data += struct.pack(self.order + kind, value)
        return self

    def text(self, text: str) -> Cdr:
        self.put("I", len(text) + 1)
        self.data += text.encode() + b"\0"
        return self


def imu(
    stamp_ns: int,
    gyro: Iterable[float],
    accel: Iterable[float],
    frame: str = "imu_link",
    *,
    big: bool = False,
    without: str = "",
) -> bytes:
    """Return one sensor_msgs/msg/Imu; `without` is the quantity that it says it does not have."""
    cdr = Cdr(big).put("i", stamp_ns // 1_000_000_000).put("I", stamp_ns % 1_000_000_000)
    cdr.text(frame).put("d", 0.0, 0.0, 0.0, 1.0, -1.0, *[0.0] * 8)
    cdr.put("d", *gyro, -1.0 if without == "gyro" else 1e-4, *[0.0] * 8)
    cdr.put("d", *accel, -1.0 if without == "accel" else 1e-4, *[0.0] * 8)
    return bytes(cdr.data)


def messages(
    gyro: NDArray[Any], accel: NDArray[Any], rate: float, topic: str = "/imu/data", **how: Any
) -> list[Message]:
    """Return the messages of one sensor; they reach the recorder 2 ms late, the third 6 ms."""
    out = []
    for i, (w, a) in enumerate(zip(gyro.tolist(), accel.tolist(), strict=True)):
        stamp = 1_700_000_000_000_000_000 + round(i * 1e9 / rate)
        out.append((topic, stamp + (6_000_000 if i == 2 else 2_000_000), imu(stamp, w, a, **how)))
    return out


def write_mcap(
    path: Path,
    said: Iterable[Message],
    kinds: dict[str, str] | None = None,
    compression: CompressionType = CompressionType.ZSTD,
    profile: str = "ros2",
    **options: Any,
) -> Path:
    """Write a bag as rosbag2_storage_mcap does."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, **options)
        writer.start(profile=profile, library="libmcap 1.3.0")
        channels: dict[str, int] = {}
        for number, (topic, at, data) in enumerate(said):
            if topic not in channels:
                kind = (kinds or {}).get(topic, IMU)
                schema = writer.register_schema(kind, "ros2msg", b"# not needed")
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], at, data, at, number)
        writer.finish()
    return path


def write_sqlite(path: Path, said: Iterable[Message], kinds: dict[str, str] | None = None) -> Path:
    """Write a bag as rosbag2_storage_sqlite3 does."""
    base = sqlite3.connect(path)
    base.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
        "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
    )
    base.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
        "timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
    )
    base.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    numbers: dict[str, int] = {}
    for topic, at, data in said:
        if topic not in numbers:
            numbers[topic] = len(numbers) + 1
            kind = (kinds or {}).get(topic, IMU)
            base.execute(
                "INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')", (numbers[topic], topic, kind)
            )
        base.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)",
            (numbers[topic], at, data),
        )
    base.commit()
    base.close()
    return path


def write_bag(folder: Path, kind: str, parts: Iterable[Iterable[Message]], **options: Any) -> Path:
    """Write a folder with its metadata.yaml, split as `ros2 bag record --max-bag-size` does."""
    folder.mkdir()
    names = []
    for number, part in enumerate(parts):
        name = f"{folder.name}_{number}.{kind}"
        (write_mcap if kind == "mcap" else write_sqlite)(folder / name, part, **options)
        names.append(name)
    listed = "".join(f"    - {name}\n" for name in names)
    text = f"rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n{listed}"
    (folder / "metadata.yaml").write_text(text)
    return folder


def sensor(n: int, seed: int = 5) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rates in rad/s and accelerations in m/s^2 of something at rest."""
    rng = np.random.default_rng(seed)
    return rng.normal(0.0, 1e-3, (n, 3)), rng.normal([0.0, 0.0, 9.81], 0.02, (n, 3))
