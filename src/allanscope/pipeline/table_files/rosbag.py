"""Bags of ROS 2 (rosbag2), as MCAP or SQLite, without any ROS: the samples of one Imu topic.

A message ``sensor_msgs/msg/Imu`` is, after four bytes that say the byte order, in CDR::

    int32 sec, uint32 nanosec, uint32 length, frame_id, padding to a multiple of 8,
    float64: orientation 4, its covariance 9,
             angular velocity in rad/s 3, its covariance 9,
             linear acceleration in m/s^2 3, its covariance 9

All messages of a topic that have one frame_id have one length, so that thousands of them are one
array of records. A covariance whose first element is -1 says that the quantity is not measured
(the messages of a camera's gyroscope have no acceleration); neither is one that is always 0.
"""

from __future__ import annotations

import mmap
import re
import sqlite3
import struct
import zlib
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode
from numpy.typing import NDArray

from allanscope.pipeline.columns import Columns
from allanscope.pipeline.table_files import MOST_BYTES, ROS_1_MAGIC, TableFile
from allanscope.recording import MCAP_MAGIC
from allanscope.samples import AXES

__all__ = ["read"]

IMU = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
MOST_TOPICS = 4096
MAX_CHUNK_BYTES = 256 << 20
"""Of one chunk, unpacked: writers have 4 MB at most unless told otherwise."""
MOST_ROWS = MOST_BYTES // 64
FEWEST_ALIKE = 8
"""Messages in a row of one topic and length from which on they are taken together."""

_HEAD = 16
_DOUBLES = 37
_RECORD = struct.Struct("<BQ").unpack_from
_MESSAGE = struct.Struct("<HIQQ").unpack_from  # channel, number, logged, published
_BEFORE_DATA = 9 + 22
_LOGGED_AT = 9 + 6
_CHUNK = struct.Struct("<QQQII").unpack_from
_BATCH = 1 << 13


def read(path: Path, stream: str = "") -> TableFile:
    """Return the samples of the topic `stream`, or of the one that has most."""
    files = sorted([*path.glob("*.mcap"), *path.glob("*.db3")], key=_in_order) or [path]
    bag = _Bag(stream)
    for file in files:
        with file.open("rb") as opened:
            magic = opened.read(_HEAD)
        if magic.startswith(ROS_1_MAGIC):
            raise ValueError(
                "a bag of ROS 1; convert it with `pip install rosbags` and "
                f"`rosbags-convert --src {file.name} --dst {file.stem}`, then analyse {file.stem}"
            )
        is_mcap = magic.startswith(MCAP_MAGIC)
        (_read_mcap if is_mcap else _read_sqlite)(file, bag)
    return TableFile(bag.columns(), "rosbag2")


def _in_order(file: Path) -> list[int | str]:
    """Return a key that puts ``bag_10.db3`` behind ``bag_9.db3``."""
    return [int(one) if one.isdecimal() else one for one in re.split(r"(\d+)", file.name)]


# --- messages to samples ------------------------------------------------------------------------


def _layout(data: bytes | memoryview, record: int, at: int) -> np.dtype[Any]:
    """Return the type of a record of so many bytes that has a message like this one at `at`.

    Raises
    ------
    ValueError
        For what is not a sensor_msgs/Imu in CDR.
    """
    if len(data) < 16 or data[0] != 0 or data[1] > 1:
        raise ValueError("a message is not in CDR")
    order = "><"[data[1]]
    (letters,) = struct.unpack_from(order + "I", data, 12)
    first = 4 + -(-(12 + letters) // 8) * 8
    if first + 8 * _DOUBLES > len(data):
        raise ValueError(f"a message of {len(data)} bytes is not a sensor_msgs/Imu")
    fields: dict[str, tuple[str, int]] = {
        "logged": ("<u8", _LOGGED_AT if at else 0),
        "sec": (order + "i4", at + 4),
        "nanosec": (order + "u4", at + 8),
        "letters": (order + "u4", at + 12),
        "gyro": (f"3{order}f8", at + first + 8 * 13),
        "gyro_known": (order + "f8", at + first + 8 * 16),
        "accel": (f"3{order}f8", at + first + 8 * 25),
        "accel_known": (order + "f8", at + first + 8 * 28),
    }
    return np.dtype(
        {
            "names": list(fields),
            "formats": [kind for kind, _ in fields.values()],
            "offsets": [offset for _, offset in fields.values()],
            "itemsize": record,
        }
    )


@dataclass(slots=True)
class _Topic:
    """One Imu topic, and the samples of it so far.

    Attributes
    ----------
    name : str
    values : list of ndarray, shape (n, 6)
    stamped, logged : list of ndarray of int64, shape (n,)
        When the device says that it was, and when the bag was written, in ns.
    gyro, accel : bool
        Whether any message says that it has them.
    runs : bool
        Whether messages of this topic come one after the other without others between.
    """

    name: str
    values: list[NDArray[np.float64]] = field(default_factory=list)
    stamped: list[NDArray[np.int64]] = field(default_factory=list)
    logged: list[NDArray[np.int64]] = field(default_factory=list)
    rows: int = 0
    gyro: bool = False
    accel: bool = False
    runs: bool = True
    waiting: list[bytes | memoryview] = field(default_factory=list)
    times: list[int] = field(default_factory=list)

    def read(self, records: bytes | memoryview, size: int, at: int) -> NDArray[Any]:
        """Take records of equal size with a message at `at` of each; return them."""
        layout = _layout(memoryview(records)[at:size], size, at)
        rows: NDArray[Any] = np.frombuffer(records, layout)
        if (rows["letters"] != rows["letters"][0]).any():
            raise ValueError(f"messages of {self.name} that contradict their length")
        self.rows += len(rows)
        if self.rows > MOST_ROWS:
            raise ValueError(f"more than {MOST_ROWS} messages")
        values = np.hstack([rows["gyro"], rows["accel"]])
        self.values.append(values.astype(np.float64, copy=False))
        self.stamped.append(rows["sec"].astype(np.int64) * 1_000_000_000 + rows["nanosec"])
        self.gyro |= bool((rows["gyro_known"] != -1.0).any())
        self.accel |= bool((rows["accel_known"] != -1.0).any())
        return rows

    def add(self, message: bytes | memoryview, logged_ns: int) -> None:
        """Take one message; many are looked at together."""
        if self.waiting and len(message) != len(self.waiting[0]):
            self.flush()
        self.waiting.append(message)
        self.times.append(logged_ns)
        if len(self.waiting) == _BATCH:
            self.flush()

    def flush(self) -> None:
        """Look at the messages that wait."""
        if self.waiting:
            self.read(b"".join(self.waiting), len(self.waiting[0]), 0)
            self.logged.append(np.array(self.times, np.uint64).astype(np.int64))
            self.waiting.clear()
            self.times.clear()


class _Bag:
    """The Imu topics of a bag.

    Parameters
    ----------
    wanted : str
        The only one to look at; empty for all.
    """

    def __init__(self, wanted: str) -> None:
        self._wanted = wanted
        self.topics: dict[str, _Topic] = {}
        self.others: set[str] = set()
        self.remarks: list[str] = []

    def topic(self, name: str, kind: str) -> _Topic | None:
        """Return where messages of a topic go; None for one that is of no interest."""
        if len(self.topics) + len(self.others) > MOST_TOPICS:
            raise ValueError(f"more than {MOST_TOPICS} topics")
        if kind not in IMU:
            self.others.add(f"{name} ({kind})")
            return None
        return self.topics.setdefault(name, _Topic(name))

    def columns(self) -> Columns:
        """Return the columns of the topic that was asked for, or has most messages."""
        for topic in self.topics.values():
            topic.flush()
        if self._wanted and self._wanted not in self.topics:
            raise ValueError(f"no Imu topic {self._wanted}; there is {_listed(self.topics)}")
        there = [topic for topic in self.topics.values() if topic.rows]
        if not there:
            what = "no message of" if self.topics else "no topic of type"
            others = f"; it has {_listed(sorted(self.others))}" if self.others else ""
            raise ValueError("; ".join([f"{what} {IMU[0]}{others}", *self.remarks]))
        chosen = self.topics[self._wanted or max(there, key=lambda one: one.rows).name]
        if not chosen.rows:
            raise ValueError(f"no message of {chosen.name}")
        remarks = list(self.remarks)
        left = [topic.name for topic in there if topic is not chosen]
        if left:
            remarks.append(f"the topic is {chosen.name}; --stream selects another: {_listed(left)}")
        return _columns(chosen, remarks)


def _listed(names: Iterable[str]) -> str:
    return (" ".join(names) or "none")[:200]


def _columns(topic: _Topic, remarks: list[str]) -> Columns:
    """Return the samples of a topic in the order of their times."""
    logged, times = np.concatenate(topic.logged), np.concatenate(topic.stamped)
    values = np.empty((len(AXES), len(times)))
    start = 0
    while topic.values:  # free each piece: a night is a gigabyte
        piece = topic.values.pop(0)
        values[:, start : start + len(piece)] = piece.T
        start += len(piece)
    if len(times) > 1 and (np.ptp(times) == 0 or (np.diff(times) == 0).mean() > 0.5):
        remarks.append("the messages have no time stamps: the times of the bag are used")
        times = logged
    if (np.diff(times) < 0).any():
        order = np.argsort(times, kind="stable")
        times, values = times[order], values[:, order]
        remarks.append("messages out of order are sorted by time")
    measured = [topic.gyro] * 3 + [topic.accel] * 3
    for first in (0, 3):
        if not values[first : first + 3].any():
            measured[first : first + 3] = [False] * 3
    axes = {axis: values[i] for i, axis in enumerate(AXES) if measured[i]}
    if not axes:
        raise ValueError(f"{topic.name} holds neither rates nor accelerations")
    bad = ~np.isfinite(values).all(axis=0)
    if bad.any():
        remarks.append(f"{int(bad.sum())} messages with values that are not finite are left out")
        axes = {axis: column[~bad] for axis, column in axes.items()}
        times = times[~bad]
    units = {axis: "rad/s" if axis[0] == "g" else "m/s2" for axis in axes}
    time_s = np.asarray((times - times[:1]) * 1e-9, np.float64)
    return Columns(axes, units, time_s, assumed=tuple(remarks))


# --- SQLite -------------------------------------------------------------------------------------


def _read_sqlite(file: Path, bag: _Bag) -> None:
    """Take the messages of a bag in SQLite; nothing but its two tables is required."""
    if file.with_name(f"{file.name}-wal").exists():
        bag.remarks.append(f"{file.name} was never closed: its last messages, in -wal, are missing")
    try:
        # Not even a lock file is written beside it.
        where = f"{file.resolve().as_uri()}?mode=ro&immutable=1"
        with closing(sqlite3.connect(where, uri=True, check_same_thread=False)) as base:
            base.execute("PRAGMA trusted_schema = OFF")
            # A view, or a virtual table, could be made up to never end.
            kinds = dict(base.execute("SELECT name, sql LIKE 'CREATE TABLE%' FROM sqlite_master"))
            if not all(kinds.get(name) for name in ("topics", "messages")):
                raise ValueError("an SQLite file that is not a ROS 2 bag")
            rows = base.execute("SELECT id, name, type FROM topics LIMIT ?", (MOST_TOPICS + 2,))
            topics = {number: bag.topic(str(name), str(kind)) for number, name, kind in rows}
            for number, topic in topics.items():
                if topic is not None:
                    _read_rows(base, number, topic)
    except sqlite3.Error as error:
        bag.remarks.append(f"{file.name} is damaged ({error}): only what can be read is used")


def _read_rows(base: sqlite3.Connection, number: int, topic: _Topic) -> None:
    """Take the messages of a topic, by ranges of rows, in the order of their numbers.

    The next range is fetched while one is looked at: SQLite needs no lock of the interpreter.
    """
    ranges = _ranges(base, number)
    with ThreadPoolExecutor(1) as pool:
        ahead = pool.submit(next, ranges, None)
        while (fetched := ahead.result()) is not None:
            ahead = pool.submit(next, ranges, None)
            rows, joined = fetched
            if joined is not None and _read_joined(joined, topic):
                continue
            singly, error = pool.submit(_singly, base, rows).result()
            for logged_ns, data in singly:
                topic.add(data, max(logged_ns, 0))
            if error is not None:
                raise error


_Range = tuple[int, int, int]
_RANGE = "FROM messages WHERE topic_id = ? AND rowid > ? AND rowid <= ?"
_JOINED = (
    "SELECT count(*), max(length(data)), group_concat(timestamp), "
    f"CAST(group_concat(data, '') AS BLOB) {_RANGE}"
)
"""Bytes joined by SQLite itself: a Python object for each of 17 million rows takes twice as long.
In a base of UTF-8 they are as text what they are."""
_LATEST = np.iinfo(np.int64).max
_SINGLY = (
    f"SELECT timestamp, data {_RANGE} AND typeof(data) = 'blob' AND typeof(timestamp) = 'integer' "
    "ORDER BY rowid"
)


def _ranges(base: sqlite3.Connection, number: int) -> Iterator[tuple[_Range, Any]]:
    """Yield ranges of rows with what they hold together; None where that cannot be had."""
    together = base.execute("PRAGMA encoding").fetchone() == ("UTF-8",)
    last = base.execute("SELECT min(rowid) - 1 FROM messages").fetchone()[0]
    while last is not None:
        rows = (number, last, last + _BATCH)
        joined = None
        if together:
            with suppress(sqlite3.Error):  # damage: what is sound is read row by row
                joined = base.execute(_JOINED, rows).fetchone()
        yield rows, joined
        following = base.execute("SELECT min(rowid) - 1 FROM messages WHERE rowid > ?", rows[2:])
        last = following.fetchone()[0]


def _read_joined(joined: tuple[Any, ...], topic: _Topic) -> bool:
    """Take the messages of a range that are all of one length; False where that cannot be."""
    count, length, times, data = joined
    if data is None:  # nothing of this topic
        return True
    if times is None or times.encode().translate(None, b"0123456789,"):
        return False  # times that are none
    try:
        logged = np.fromstring(times, np.int64, sep=",")  # five times as fast as splitting
    except ValueError:  # nothing between two commas
        return False
    if logged.max(initial=0) == _LATEST:  # of more digits it takes this
        return False
    if len(logged) != count or len(data) != length * count:  # some have none, or are shorter
        return False
    topic.flush()
    topic.read(data, length, 0)
    topic.logged.append(logged)
    return True


def _singly(
    base: sqlite3.Connection, rows: _Range
) -> tuple[list[tuple[int, bytes]], sqlite3.Error | None]:
    """Return the messages of a range up to what is damaged, and what SQLite says of that."""
    found: list[tuple[int, bytes]] = []
    try:
        found.extend(base.execute(_SINGLY, rows))
    except sqlite3.Error as error:
        return found, error
    return found, None


# --- MCAP ---------------------------------------------------------------------------------------


def _read_mcap(file: Path, bag: _Bag) -> None:
    """Take the messages of a bag in MCAP, its chunks unpacked one after the other."""
    with file.open("rb") as opened:
        whole = mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ)
    records = _Records(bag)
    if not records.read(memoryview(whole)[len(MCAP_MAGIC) :]):
        bag.remarks.append(f"{file.name} was never closed: its end may be missing")
    if records.damaged:
        first = records.damaged[0]
        bag.remarks.append(f"{file.name}: {len(records.damaged)} chunks are left out ({first})")


class _DamagedError(ValueError):
    """A chunk does not hold what was written to it."""


class _Records:
    """Follows the records of a file and of its chunks."""

    def __init__(self, bag: _Bag) -> None:
        self._bag = bag
        self._kinds: dict[int, str] = {}
        self._channels: dict[int, _Topic | None] = {}
        self.damaged: list[str] = []

    def read(self, data: memoryview, inside: bool = False) -> bool:
        """Take the messages among these records; return whether they came to an end."""
        position, stop = 0, len(data)
        while position + 9 <= stop:
            opcode, length = _RECORD(data, position)
            size = 9 + length
            if position + size > stop:
                return False
            if opcode == Opcode.MESSAGE and length >= 22:
                position += self._message(data, position, size)
                continue
            if opcode == Opcode.CHUNK and not inside:
                try:
                    self.read(memoryview(_unpacked(data[position + 9 : position + size])), True)
                except _DamagedError as error:
                    self.damaged.append(str(error))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._declare(opcode, bytes(data[position + 9 : position + size]))
            elif opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return True
            position += size
        return inside

    def _message(self, data: memoryview, position: int, size: int) -> int:
        """Take a message, and those like it that follow at once; return their bytes."""
        channel, _, logged_ns, _ = _MESSAGE(data, position + 9)
        topic = self._channels.get(channel)
        if topic is None:
            return size
        if topic.runs:
            count = _alike(data, position, size)
            topic.runs = count >= FEWEST_ALIKE
            if topic.runs:
                topic.flush()
                rows = topic.read(data[position : position + count * size], size, _BEFORE_DATA)
                topic.logged.append(rows["logged"].astype(np.int64))
                return count * size
        topic.add(bytes(data[position + _BEFORE_DATA : position + size]), logged_ns)
        return size

    def _declare(self, opcode: int, body: bytes) -> None:
        """Note the type of a schema, or the topic of a channel."""
        if opcode == Opcode.SCHEMA:
            (number,) = struct.unpack_from("<H", body)
            self._kinds[number] = next(_strings(body, 2))
            return
        number, schema = struct.unpack_from("<HH", body)
        name, encoding = [one for one, _ in zip(_strings(body, 4), range(2), strict=False)]
        kind = self._kinds.get(schema, "") if encoding == "cdr" else encoding
        self._channels[number] = self._bag.topic(name, kind)


def _alike(data: memoryview, position: int, size: int) -> int:
    """Return how many records with the head of the first one follow each other from here."""
    count = (len(data) - position) // size
    rows = np.frombuffer(data, np.uint8, count * size, position).reshape(count, size)[:, :11]
    same = (rows == rows[0]).all(axis=1)
    return count if bool(same.all()) else int(same.argmin())


def _strings(body: bytes, position: int) -> Iterator[str]:
    while position < len(body):
        (length,) = struct.unpack_from("<I", body, position)
        position += 4 + length
        yield body[position - length : position].decode("utf-8", "replace")


def _unpacked(chunk: memoryview) -> bytes | memoryview:
    """Return the records of a chunk.

    Raises
    ------
    _DamagedError
        If they are damaged, or more than any chunk has.
    """
    _, _, size, crc, name_length = _CHUNK(chunk)
    at = 32 + name_length
    compression = bytes(chunk[32:at]).decode("ascii", "replace")
    packed = chunk[at + 8 :]
    if size > MAX_CHUNK_BYTES:
        raise _DamagedError(f"a chunk that claims to unpack to {size} bytes")
    data: bytes | memoryview
    try:
        if compression == "zstd":
            data = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
        elif compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
        elif not compression:
            data = packed
        else:
            raise _DamagedError(f"a chunk is packed with {compression!r}, which is not supported")
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise _DamagedError(f"a chunk cannot be unpacked: {error}") from None
    if len(data) != size or (crc and zlib.crc32(data) != crc):
        raise _DamagedError("a chunk has the wrong checksum")
    return data
