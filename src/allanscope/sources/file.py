"""A file of bytes as a source: a raw capture of a serial port, or a table as text."""

from __future__ import annotations

import gzip
import threading
import zlib
from pathlib import Path
from typing import IO, cast

from allanscope.errors import InputError
from allanscope.recording.chunk import Chunk

__all__ = ["FileSource"]

READ_BYTES = 1 << 18
MAX_UNPACKED_BYTES = 1 << 36
"""More than this out of a compressed file is a bomb and no capture: months of a device."""

_GZIP_MAGIC = b"\x1f\x8b"


class FileSource:
    """Gives the bytes of a file, unpacked if it is gzip, without any time: `host_ns` is 0.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InputError
        If it is empty, a folder, or cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reading = threading.Lock()
        self._unpacked = 0
        try:
            self._file = _opened(path)
            self._ahead = self._next()
        except OSError as error:
            raise InputError(f"cannot read {path}: {error.strerror or error}") from error
        if not self._ahead:
            self._file.close()
            raise InputError(f"{path} is empty")

    @property
    def name(self) -> str:
        """The file."""
        return str(self._path)

    @property
    def identity(self) -> dict[str, str]:
        """Name and size of the file."""
        return {"file": self._path.name, "file_bytes": str(self._path.stat().st_size)}

    def read(self) -> Chunk:
        """Return the next piece.

        Raises
        ------
        InputError
            If the file cannot be read to its end.
        """
        with self._reading:
            data = self._ahead
            if not data:
                self._file.close()
                return Chunk(0, event="end")
            try:
                self._ahead = self._next()
            except OSError as error:
                raise InputError(f"cannot read {self._path}: {error.strerror or error}") from error
            return Chunk(0, data)

    def write(self, data: bytes) -> None:
        """Do nothing: a file does not listen."""

    def close(self) -> None:
        """Stop."""
        with self._reading:
            self._ahead = b""
            self._file.close()

    def _next(self) -> bytes:
        try:
            data = self._file.read(READ_BYTES)
        except (EOFError, gzip.BadGzipFile, zlib.error) as error:
            raise InputError(
                f"{self._path}: the compressed data is damaged after {self._unpacked} bytes"
            ) from error
        self._unpacked += len(data)
        if self._unpacked > MAX_UNPACKED_BYTES:
            raise InputError(f"{self._path} unpacks to more than {MAX_UNPACKED_BYTES} bytes")
        return data


def _opened(path: Path) -> IO[bytes]:
    file = path.open("rb")
    if file.read(len(_GZIP_MAGIC)) != _GZIP_MAGIC:
        file.seek(0)
        return file
    file.close()
    return cast("IO[bytes]", gzip.open(path, "rb"))
