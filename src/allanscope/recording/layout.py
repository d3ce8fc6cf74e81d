"""Layout of a session on disk: names of files, topics, records and their limits.

A session is one MCAP file, or several where it grew long: ``session.mcap``, ``session-001.mcap``,
``session-002.mcap``, ... Every file stands for itself and begins with a metadata record, so that
any of them can be read when the others are gone. Within a file:

=============== ========================== ======================================================
topic           one message is             data
=============== ========================== ======================================================
``/serial/rx``  one read of the source     the bytes
``/serial/tx``  one write to the device    the bytes
``/events``     one remark                 a JSON object whose ``kind`` says what it is
=============== ========================== ======================================================

``publish_time`` is the host's monotonic clock, exactly as it was read: it is what a replay gives
back. ``log_time`` is the same moment as time since 1970, computed from the monotonic time and one
anchor taken at the start, so that a clock that is set in the night makes no gap. ``sequence``
counts the messages of a topic from 1; a number that is missing on ``/serial/rx`` is a read that is
missing, and that is how a reader knows that two reads are no neighbours.

The metadata record says what a recording is. MCAP protects chunks by a checksum but not metadata
records, and a part name that one flipped bit has changed into another would pass. The record
therefore carries a CRC-32 of its own (`sealed`).
"""

from __future__ import annotations

import glob
import json
import platform
import re
import zlib
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from allanscope.errors import InputError
from allanscope.sanitize import encodable

__all__ = [
    "CHANNELS",
    "MCAP_MAGIC",
    "circumstances",
    "first_segment",
    "is_intact",
    "sealed",
    "segment_number",
    "segment_path",
    "session_files",
]

MCAP_MAGIC = b"\x89MCAP0\r\n"

PROFILE = "allanscope"
"""Profile in the MCAP header, and name of our metadata record."""

RX = "/serial/rx"
TX = "/serial/tx"
EVENTS = "/events"

CHANNELS = {RX: 1, TX: 2, EVENTS: 3}
"""Channel numbers, always these: a file whose first chunk is corrupt can still be read."""

EVENT_SCHEMA = b'{"type":"object","properties":{"kind":{"type":"string"}},"required":["kind"]}'

_NUMBERED = re.compile(r"(?P<stem>.+)-(?P<number>\d{3,})\.mcap")
SEAL = "crc32"


def segment_path(first: Path, number: int) -> Path:
    """Return the name of a file of the session that `first` begins.

    >>> segment_path(Path("night/session.mcap"), 0).name
    'session.mcap'
    >>> segment_path(Path("night/session.mcap"), 12).name
    'session-012.mcap'
    """
    return first if number == 0 else first.with_name(f"{first.stem}-{number:03d}{first.suffix}")


def first_segment(path: Path) -> Path:
    """Return the file that a session begins with, given that file or its folder.

    Raises
    ------
    InputError
        If the folder holds no session, or more than one.
    """
    if not path.is_dir():
        return path
    names = {file.name for file in path.glob("*.mcap")}
    firsts = [path / name for name in sorted(names) if not _continues_one_of(names, name)]
    if path / "session.mcap" in firsts:
        return path / "session.mcap"
    if len(firsts) != 1:
        what = "no recording" if not firsts else f"{len(firsts)} recordings; name one of them"
        raise InputError(f"{path} contains {what}")
    return firsts[0]


def segment_number(first: Path, file: Path) -> int | None:
    """Return the number of a file in the session that `first` begins; None if it is of another.

    >>> segment_number(Path("session.mcap"), Path("session-012.mcap"))
    12
    """
    if file.name == first.name:
        return 0
    match = _NUMBERED.fullmatch(file.name)
    return int(match["number"]) if match and match["stem"] == first.stem else None


def session_files(path: Path) -> list[Path]:
    """Return the files of a session in order, given its first file or its folder.

    A later file given by its own name stands alone: whoever names it means it.
    """
    first = first_segment(path)
    files = {
        number: file
        for file in first.parent.glob(f"{glob.escape(first.stem)}-*.mcap")
        if (number := segment_number(first, file)) is not None
    }
    return [first, *(files[number] for number in sorted(files))]


def _continues_one_of(names: set[str], name: str) -> bool:
    match = _NUMBERED.fullmatch(name)
    return match is not None and match["stem"] + ".mcap" in names


def circumstances(epoch_ns: int) -> dict[str, str]:
    """Return what every recording says: who made it, where, and when."""
    try:
        own = version("allanscope")
    except PackageNotFoundError:
        own = ""
    return {
        "allanscope": own,
        "format": "1",
        "host": platform.node(),
        "system": platform.platform(),
        "started": datetime.fromtimestamp(epoch_ns * 1e-9, UTC).isoformat(timespec="milliseconds"),
    }


def sealed(metadata: Mapping[str, str]) -> dict[str, str]:
    """Return the metadata with its checksum.

    >>> sealed({"part": "LSM6DSM"})
    {'part': 'LSM6DSM', 'crc32': '8f5026e9'}
    """
    plain = {key: encodable(value) for key, value in metadata.items() if key != SEAL}
    return {**plain, SEAL: _checksum(plain)}


def is_intact(metadata: Mapping[str, str]) -> bool:
    """Return whether the metadata is what was written."""
    plain = {key: value for key, value in metadata.items() if key != SEAL}
    return metadata.get(SEAL) == _checksum(plain)


def _checksum(plain: Mapping[str, str]) -> str:
    return f"{zlib.crc32(json.dumps(plain, sort_keys=True).encode()):08x}"
