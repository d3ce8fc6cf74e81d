"""What a source is: chunks of bytes with their times. And which source a name means."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from allanscope.errors import InputError, UsageError
from allanscope.recording import Chunk, LinkEvent

__all__ = [
    "Chunk",
    "LinkEvent",
    "Source",
    "SourceSettings",
    "open_file",
    "open_source",
    "require_port",
]


class Source(Protocol):
    """A place that bytes come from. One thread reads it; any thread may write or close it."""

    @property
    def name(self) -> str:
        """The port, the file, or ``sim``: shown to people."""

    @property
    def identity(self) -> dict[str, str]:
        """What is known of the device: vendor, product, serial number, path."""

    @property
    def reader(self) -> str:
        """Who reads a port, and at which priority; empty where nothing can come too fast."""

    def read(self) -> Chunk:
        """Return the next chunk, with empty data after about a tenth of a second of silence."""

    def write(self, data: bytes) -> None:
        """Send bytes to the device; does nothing where there is none."""

    def close(self) -> None:
        """Stop; a read in another thread returns soon with the event ``end``."""


@dataclass(frozen=True, slots=True)
class SourceSettings:
    """Settings of all kinds of sources; each takes what concerns it.

    Attributes
    ----------
    baud : int
        Line rate of a UART. A USB CDC device ignores it.
    stall_s : float
        A device that has streamed and then says nothing for this long has stalled.
    give_up_s : float
        A device that has gone is waited for this long; for ever, if not given.
    own_process : bool
        Whether a port is read by a process of its own, where the system allows it (Linux).
    speed : float
        Multiple of real time at which a recording is replayed; infinity for as fast as possible.

    Raises
    ------
    UsageError
        If a value is not possible.
    """

    baud: int = 115200
    stall_s: float = 3.0
    give_up_s: float = math.inf
    speed: float = math.inf
    own_process: bool = True

    def __post_init__(self) -> None:
        for name in ("baud", "stall_s", "give_up_s", "speed"):
            if not getattr(self, name) > 0:
                raise UsageError(f"{name} must be positive, not {getattr(self, name)}")


def _is_recording(spec: str) -> bool:
    from allanscope.recording import is_recording  # loads numpy, which a list of ports needs not

    return Path(spec).is_dir() or is_recording(Path(spec))


def _is_file(spec: str) -> bool:
    """Whether it is a file, or a missing one that was surely meant to be one."""
    path = Path(spec)
    meant = bool(path.suffix) and "://" not in spec and not spec.startswith("/dev/")
    return path.is_file() or (meant and not path.exists())


def _open_simulated(spec: str, settings: SourceSettings) -> Source:
    from allanscope.sources.simulated import SimulatedSource

    return SimulatedSource(settings=settings)


def _open_board(spec: str, settings: SourceSettings) -> Source:
    from allanscope.sources.discovery import auto_port

    return _open_port(auto_port().device, settings)


def _open_iio(spec: str, settings: SourceSettings) -> Source:
    from allanscope.sources.iio import IioSource

    return IioSource(spec, settings)


def _open_recording(spec: str, settings: SourceSettings) -> Source:
    from allanscope.sources.file import RecordedSource

    return RecordedSource(Path(spec), settings.speed)


def _open_file(spec: str, settings: SourceSettings) -> Source:
    from allanscope.sources.file import FileSource

    return FileSource(Path(spec))


def _open_port(spec: str, settings: SourceSettings) -> Source:
    from allanscope.sources.serial_port import SerialSource

    return SerialSource(spec, settings)


_KINDS: tuple[tuple[Callable[[str], bool], Callable[[str, SourceSettings], Source]], ...] = (
    (lambda spec: spec == "sim", _open_simulated),
    (lambda spec: spec == "auto", _open_board),
    (lambda spec: spec == "iio" or spec.startswith("iio:"), _open_iio),
    (_is_recording, _open_recording),
    (_is_file, _open_file),
    (lambda _: True, _open_port),
)
"""What a name may mean, in the order in which it is asked, and how that is opened."""


def open_source(spec: str, settings: SourceSettings | None = None) -> Source:
    """Open whatever a name means.

    Parameters
    ----------
    spec : str
        ``sim``, the simulated device; ``auto``, the board that is plugged in; ``iio`` or
        ``iio:NAME``, a sensor of Linux IIO; a recording or the folder of one; any other file, as a
        raw capture; else a serial port or a pyserial URL.
    settings : SourceSettings, optional
        How.

    Raises
    ------
    DeviceError
        If a port cannot be opened, or no board is found.
    InputError
        If a file cannot be read.
    """
    opener = next(opener for means, opener in _KINDS if means(spec))
    return opener(spec, settings or SourceSettings())


def open_file(path: Path) -> Source:
    """Open a recording or a capture: a file that is called sim or auto is neither of these.

    Raises
    ------
    InputError
        If it cannot be read, or is a port, which has no end.
    """
    if path.is_char_device():
        raise InputError(f"{path} is not a file; a port is read by allanscope live {path}")
    means_it = _open_recording if _is_recording(str(path)) else _open_file
    return means_it(str(path), SourceSettings())


def require_port(spec: str) -> None:
    """Say at once that there is no such port: what comes before it is opened takes its time.

    Raises
    ------
    DeviceError
        Lists what is there.
    """
    if spec == "auto":
        from allanscope.sources.discovery import auto_port

        auto_port()
    elif spec.startswith("/dev/") and not Path(spec).exists():
        open_source(spec).close()
