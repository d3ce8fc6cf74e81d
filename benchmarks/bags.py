"""How long a night in a ROS 2 bag takes to read.

    python benchmarks/bags.py [--hours 24] [--rate 200] [--kinds mcap zstd sqlite]

Writes a bag of one sensor_msgs/msg/Imu topic (24 h x 200 Hz: 17 million messages, 6 GB) into a
temporary folder, reads it by the function that `analyse` and `import` call, and prints wall time,
processor time and peak memory of a process of its own. The values read are compared with those
written. ``mcap`` has chunks of 4 MB, ``zstd`` the same compressed, ``sqlite`` is a .db3. The file
is read from memory where that is large enough: a disk adds what it adds.
"""

from __future__ import annotations

import argparse
import json
import sqlite3
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import zstandard
from numpy.typing import NDArray

PER_CHUNK = 12_000
BEGIN_NS = 1_700_000_000_000_000_000
FRAME = b"imu_link\0"
BODY = 4 + 24 + 37 * 8
"""Bytes of a message: byte order, stamp and frame, 37 numbers."""

READ = """
import json, resource, sys, time
from pathlib import Path
import numpy as np
from allanscope.pipeline.table_files import table_of_file
wall, cpu = time.perf_counter(), time.process_time()
columns = table_of_file(Path(sys.argv[1])).columns
wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
sums = [float(np.sum(values)) for values in columns.axes.values()]
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps({"wall_s": wall, "cpu_s": cpu, "peak_mb": peak / 1e3, "sums": sums,
                  "rows": len(columns.time_s)}))
"""


def messages(count: int, rate: float) -> Iterator[tuple[NDArray[np.void], NDArray[np.float64]]]:
    """Yield records of an MCAP with a message each, and the six values of each, by chunks."""
    fields = {
        "opcode": ("u1", 0),
        "length": ("<u8", 1),
        "channel": ("<u2", 9),
        "number": ("<u4", 11),
        "logged": ("<u8", 15),
        "published": ("<u8", 23),
        "order": ("<u4", 31),
        "sec": ("<i4", 35),
        "nanosec": ("<u4", 39),
        "letters": ("<u4", 43),
        "frame": (f"S{len(FRAME)}", 47),
        "numbers": ("37<f8", 31 + 28),
    }
    kind = np.dtype(
        {
            "names": list(fields),
            "formats": [one for one, _ in fields.values()],
            "offsets": [at for _, at in fields.values()],
            "itemsize": 31 + BODY,
        }
    )
    rng = np.random.default_rng(1)
    for start in range(0, count, PER_CHUNK):
        number = np.arange(start, min(start + PER_CHUNK, count))
        rows = np.zeros(len(number), kind)
        stamp = BEGIN_NS + np.rint(number * (1e9 / rate)).astype(np.int64)
        rows["opcode"], rows["length"], rows["channel"] = 5, 22 + BODY, 1
        rows["number"] = number
        rows["logged"] = rows["published"] = stamp + 2_000_000
        rows["order"] = 0x0100  # 00 01 00 00: CDR, little endian
        rows["sec"], rows["nanosec"] = stamp // 10**9, stamp % 10**9
        rows["letters"], rows["frame"] = len(FRAME), FRAME
        values = rng.normal((0, 0, 0, 0, 0, 9.80665), 0.01, (len(number), 6))
        rows["numbers"][:, 13:16] = values[:, :3]
        rows["numbers"][:, 25:28] = values[:, 3:]
        yield rows, values


def text(value: bytes) -> bytes:
    """Return a string as MCAP has it."""
    return struct.pack("<I", len(value)) + value


def record(opcode: int, body: bytes) -> bytes:
    """Return a record of an MCAP."""
    return struct.pack("<BQ", opcode, len(body)) + body


def write_mcap(path: Path, count: int, rate: float, compressed: bool) -> NDArray[np.float64]:
    """Write a bag as MCAP; return the sum of each axis."""
    kind = text(b"sensor_msgs/msg/Imu") + text(b"ros2msg") + text(b"# not needed")
    schema = record(3, struct.pack("<H", 1) + kind)
    about = text(b"/imu/data") + text(b"cdr") + struct.pack("<I", 0)
    channel = record(4, struct.pack("<HH", 1, 1) + about)
    sums = np.zeros(6)
    with path.open("wb") as file:
        file.write(b"\x89MCAP0\r\n" + record(1, text(b"ros2") + text(b"libmcap 1.3.0")))
        for rows, values in messages(count, rate):
            sums += values.sum(axis=0)
            data = schema + channel + rows.tobytes()
            packed = zstandard.ZstdCompressor(level=1).compress(data) if compressed else data
            head = struct.pack(
                "<QQQI", int(rows["logged"][0]), int(rows["logged"][-1]), len(data), 0
            )
            name = text(b"zstd" if compressed else b"")
            file.write(record(6, head + name + struct.pack("<Q", len(packed)) + packed))
        file.write(record(15, bytes(4)) + record(2, bytes(20)) + b"\x89MCAP0\r\n")
    return sums


def write_sqlite(path: Path, count: int, rate: float) -> NDArray[np.float64]:
    """Write a bag as SQLite; return the sum of each axis."""
    sums = np.zeros(6)
    base = sqlite3.connect(path)
    base.execute("PRAGMA journal_mode = OFF")
    base.execute("PRAGMA synchronous = OFF")
    base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, format TEXT)")
    base.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data BLOB)"
    )
    base.execute("INSERT INTO topics VALUES(1, '/imu/data', 'sensor_msgs/msg/Imu', 'cdr')")
    for rows, values in messages(count, rate):
        sums += values.sum(axis=0)
        size, data = rows.itemsize, rows.tobytes()
        base.executemany(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)",
            (
                (logged, data[i * size + 31 : (i + 1) * size])
                for i, logged in enumerate(rows["logged"].tolist())
            ),
        )
    base.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    base.commit()
    base.close()
    return sums


def main() -> None:
    """Write, read and print."""
    asked = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    asked.add_argument("--hours", type=float, default=24.0)
    asked.add_argument("--rate", type=float, default=200.0)
    asked.add_argument("--kinds", nargs="+", default=["mcap", "zstd", "sqlite"])
    options = asked.parse_args()
    count = round(options.hours * 3600 * options.rate)
    for kind in options.kinds:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / ("bag.db3" if kind == "sqlite" else "bag.mcap")
            if kind == "sqlite":
                sums = write_sqlite(path, count, options.rate)
            else:
                sums = write_mcap(path, count, options.rate, kind == "zstd")
            command = [sys.executable, "-c", READ, str(path)]
            run = subprocess.run(command, check=True, capture_output=True, text=True)
            found = json.loads(run.stdout)
            if found["rows"] != count or not np.allclose(found["sums"], sums, rtol=1e-6, atol=1e-3):
                raise SystemExit(f"{kind}: what was read is not what was written: {found}")
            print(
                f"{kind:6s} {count / 1e6:5.2f} million messages, {path.stat().st_size / 1e9:.2f} GB"
                f": "
                f"{found['wall_s']:.1f} s, {found['cpu_s']:.1f} s of processor time, "
                f"at most {found['peak_mb']:.0f} MB",
                flush=True,
            )


if __name__ == "__main__":
    main()
