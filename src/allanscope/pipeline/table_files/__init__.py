"""Samples in binary files and in folders of them, each kind a module: to columns.

::

    path ─▶ `kind_of` ─┬▶ arrays    .npz, .npy
                       ├▶ matlab    .mat
                       ├▶ parquet   .parquet                    ─▶ TableFile
                       ├▶ rosbag    rosbag2: .mcap, .db3, folder
                       ├▶ ulog      .ulg of PX4
                       ├▶ hsdatalog folder of FP-SNS-DATALOG2
                       └▶ iio       folder of iio_genxml and iio_readdev

Nothing in such a file is run: pickled objects are refused. What a header claims is compared with
what the file has before any memory is taken for it, and no more than `MOST_BYTES` is unpacked.

A new kind is a module with a function ``read(path, stream) -> TableFile`` that raises ValueError,
and a line in ``_MODULES``.
"""

from __future__ import annotations

import re
import struct
import zipfile
import zlib
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from allanscope.errors import InputError, UsageError
from allanscope.pipeline.columns import Columns
from allanscope.recording import MCAP_MAGIC

__all__ = [
    "MATLAB_4_BYTES",
    "MOST_BYTES",
    "MOST_COLUMNS",
    "MOST_MEMBERS",
    "ROS_1_MAGIC",
    "Matlab4Header",
    "TableFile",
    "is_table_file",
    "kind_of",
    "matlab_4_header",
    "table_of_file",
]

MOST_BYTES = 1 << 31
"""Of arrays in memory: six axes as float64 over 11 h at 1 kHz."""
MOST_MEMBERS = 256
MOST_COLUMNS = 4096
"""More than this is no table of sensors."""


@dataclass(frozen=True, slots=True)
class TableFile:
    """What a file of arrays holds.

    Attributes
    ----------
    columns : Columns
        Its samples.
    kind : str
        What it is, by its name in the registry.
    rate_hz : float or None
        Rate that it states.
    part : str
        Part that it names.
    """

    columns: Columns
    kind: str
    rate_hz: float | None = None
    part: str = ""


ROS_1_MAGIC = b"#ROSBAG V2.0"
"""Of a bag of ROS 1, which is refused with what to do."""
_HEAD = 64
_XML_HEAD = 1 << 14
_MAGICS: tuple[tuple[bytes, str], ...] = (
    (b"PK\x03\x04", "npz"),
    (b"\x93NUM", "npy"),
    (b"PAR1", "parquet"),
    (b"MATLAB 5.0 MAT-file", "mat"),
    (b"MATLAB 7.3 MAT-file", "mat"),
    (b"SQLite format 3\0", "rosbag2"),
    (b"ULog\x01\x12\x35", "ulog"),
    (ROS_1_MAGIC, "rosbag2"),
)
_MATLAB_4_KINDS = [10 * number + kind for number in range(6) for kind in range(3)]
_MATLAB_NAME = re.compile(rb"[A-Za-z]\w*\0?")
_ROS2 = b"\x04\x00\x00\x00ros2"
_HSDATALOG = ("acquisition_info.json", "device_config.json")
_IIO = ("context.xml", b"<context")
_MODULES = {
    "npz": "arrays",
    "npy": "arrays",
    "mat": "matlab",
    "parquet": "parquet",
    "rosbag2": "rosbag",
    "hsdatalog": "hsdatalog",
    "iio": "iio",
    "ulog": "ulog",
}


def is_table_file(path: Path) -> bool:
    """Return whether a file or a folder begins as one of these does."""
    return kind_of(path) != ""


def kind_of(path: Path) -> str:
    """Return the name of the kind, empty for what is none of them."""
    try:
        if path.is_dir():
            return _kind_of_folder(path)
        if not path.is_file():
            return ""  # a serial port must not be opened just to look
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return ""
    if head.startswith(MCAP_MAGIC):
        # After the magic comes the header record: opcode, length, and whose profile it is.
        return "rosbag2" if head[len(MCAP_MAGIC) + 9 :].startswith(_ROS2) else ""
    kind = next((kind for magic, kind in _MAGICS if head.startswith(magic)), "")
    return kind or ("mat" if _is_matlab_4(head) else "")


class Matlab4Header(NamedTuple):
    """What a matrix of a ``.mat`` of version 4 begins with, before its name and its numbers.

    Attributes
    ----------
    kind : int
        Type of its numbers in the tens, and of the matrix in the ones.
    is_complex : int
        0 or 1.
    name_bytes : int
        Length of the name, with a zero at its end.
    """

    kind: int
    rows: int
    columns: int
    is_complex: int
    name_bytes: int


MATLAB_4_BYTES = 20


def matlab_4_header(head: bytes) -> Matlab4Header | None:
    """Return the header that a matrix of version 4 begins with, or None for what is none."""
    order = "<" if head[3] == 0 else ">"  # the first is 0 to 52, from 1000 on when big-endian
    kind, *others = struct.unpack_from(order + "5i", head)
    found = Matlab4Header(kind % 1000, *others)
    is_one = (
        kind // 1000 == (order == ">")
        and found.kind in _MATLAB_4_KINDS
        and min(others) >= 0
        and found.is_complex <= 1
    )
    return found if is_one else None


def _is_matlab_4(head: bytes) -> bool:
    """Return whether a file begins as a ``.mat`` of version 4, which has no magic of its own."""
    header = matlab_4_header(head) if len(head) >= MATLAB_4_BYTES else None
    if header is None or not 2 <= header.name_bytes <= 64:
        return False
    return _MATLAB_NAME.fullmatch(head[MATLAB_4_BYTES:][: header.name_bytes]) is not None


def _kind_of_folder(path: Path) -> str:
    if all((path / name).is_file() for name in _HSDATALOG):
        return "hsdatalog"
    if (path / _IIO[0]).is_file():
        with (path / _IIO[0]).open("rb") as file:
            # A document type of its own stands before the element.
            return "iio" if _IIO[1] in file.read(_XML_HEAD) else ""
    bags = sorted([*path.glob("*.db3"), *path.glob("*.mcap")])
    return "rosbag2" if bags and kind_of(bags[0]) == "rosbag2" else ""


def table_of_file(path: Path, stream: str = "") -> TableFile:
    """Read a file, or a folder, of arrays.

    Parameters
    ----------
    path : Path
    stream : str
        Which one of several sensors it is about: the topic of a bag or a log, the part in a
        folder of HSDatalog or libiio. Without it the one with the most samples is taken, and the
        others are reported.

    Raises
    ------
    InputError
        When it is damaged, too large, or holds no axis; the message says which arrays it has.
    UsageError
        When it needs a package that is not installed.
    """
    kind = kind_of(path)
    module = import_module(f"allanscope.pipeline.table_files.{_MODULES[kind]}")
    try:
        found: TableFile = module.read(path, stream)
    except (ValueError, EOFError, zlib.error, zipfile.BadZipFile, struct.error) as error:
        if isinstance(error, UsageError):
            raise
        raise InputError(f"{path}: {_line(error)}") from None
    except (OSError, NotImplementedError, RuntimeError, MemoryError) as error:
        raise InputError(f"cannot read {path}: {_line(error)}") from None
    return found


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
