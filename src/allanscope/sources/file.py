"""Files as sources: a recording, or any file of bytes.

A `RecordedSource` gives the chunks of that night again, at any speed; a `FileSource` the bytes of a
raw capture of a serial port, or of a table as text, which have no times.
"""

from __future__ import annotations

import gzip
import math
import threading
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import IO, cast

from allanscope.errors import InputError
from allanscope.recording import Chunk, Recording, most_unpacked

__all__ = ["FileSource", "RecordedSource"]

READ_BYTES = 1 << 18
_GZIP_MAGIC = b"\x1f\x8b"
_IS_RESULT = b'"schema": "allanscope/'
WAIT_S = 0.05


class FileSource:
    """Gives the bytes of a file, unpacked if it is gzip, without any time: `host_ns` is 0.

    Parameters
    ----------
    path : Path
        The file.

    Attributes
    ----------
    size : int or None
        Bytes that there are to read; None of a compressed file.

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
            packed = isinstance(self._file, gzip.GzipFile)
            self.size = None if packed else path.stat().st_size
            self._ahead = self._next()
        except OSError as error:
            raise InputError(f"cannot read {path}: {error.strerror or error}") from error
        if not self._ahead:
            self._file.close()
            raise InputError(f"{path} is empty")
        if path.suffix == ".json" and _IS_RESULT in self._ahead:
            self._file.close()
            raise InputError(f"{path} is a result; name its recording or the folder of its session")

    @property
    def name(self) -> str:
        """The file."""
        return str(self._path)

    @property
    def identity(self) -> dict[str, str]:
        """Name and size of the file."""
        return {"file": self._path.name, "file_bytes": str(self._path.stat().st_size)}

    @property
    def reader(self) -> str:
        """No device: a file waits."""
        return ""

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
        if isinstance(self._file, gzip.GzipFile):
            packed = cast("IO[bytes]", self._file.fileobj).tell()  # so far
            if self._unpacked > most_unpacked(packed):
                raise InputError(
                    f"{self._path}: {packed} bytes unpack to more than {most_unpacked(packed)}, "
                    "as no sensor's data does; unpack it first if it is sound"
                )
        return data


def _opened(path: Path) -> IO[bytes]:
    file = path.open("rb")
    if file.read(len(_GZIP_MAGIC)) != _GZIP_MAGIC:
        file.seek(0)
        return file
    file.close()
    return cast("IO[bytes]", gzip.open(path, "rb"))


class RecordedSource:
    """Replays a recording; times are those that were recorded, whatever the speed.

    Parameters
    ----------
    path : Path
        A recording or the folder of a session.
    speed : float
        Multiple of real time; infinity for as fast as possible.
    clock : callable
        Seconds that pass while replaying.

    Raises
    ------
    InputError
        If it is no recording.
    """

    def __init__(
        self,
        path: Path,
        speed: float = math.inf,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.recording = Recording(path)
        self._speed = speed
        self._clock = clock
        self._chunks = self.recording.chunks()
        self._next: Chunk | None = next(self._chunks, None)
        self._anchor: tuple[float, int] | None = None
        self._last_ns = self._next.host_ns if self._next else 0
        self._closing = threading.Event()

    @property
    def name(self) -> str:
        """The file or folder."""
        return str(self.recording.path)

    @property
    def identity(self) -> dict[str, str]:
        """What the recording says about the device and itself."""
        return self.recording.metadata

    @property
    def reader(self) -> str:
        """No device: a file waits."""
        return ""

    def read(self) -> Chunk:
        """Return the next chunk when its time has come, else an empty one after 50 ms."""
        chunk = self._next
        if chunk is None or self._closing.is_set():
            return Chunk(self._last_ns, event="end")
        wait_s = self._wait_s(chunk)
        if wait_s > 0.0:
            self._closing.wait(min(wait_s, WAIT_S))
            wait_s = self._wait_s(chunk)
            if wait_s > 0.0:
                return Chunk(max(chunk.host_ns - int(wait_s * self._speed * 1e9), self._last_ns))
        self._next = next(self._chunks, None)
        self._last_ns = chunk.host_ns
        return chunk

    def write(self, data: bytes) -> None:
        """Do nothing: a recording does not listen."""

    def close(self) -> None:
        """Stop."""
        self._closing.set()

    def _wait_s(self, chunk: Chunk) -> float:
        if math.isinf(self._speed):
            return 0.0
        # Behind a gap the clock may be another: a resumed session, perhaps after a reboot.
        if self._anchor is None or chunk.event == "hole" or chunk.host_ns < self._anchor[1]:
            self._anchor = self._clock(), chunk.host_ns
        began_s, began_ns = self._anchor
        return began_s + (chunk.host_ns - began_ns) * 1e-9 / self._speed - self._clock()
