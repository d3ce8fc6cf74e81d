"""All kinds of sources, and which of them a name on the command line means."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from allanscope.recording.reader import is_recording
from allanscope.sources.base import Source
from allanscope.sources.settings import SourceSettings

__all__ = ["open_source"]


@dataclass(frozen=True, slots=True)
class _Kind:
    """One kind of source: what names mean it, and the function that opens it."""

    means: Callable[[str], bool]
    module: str
    opener: str


def _is_recording(spec: str) -> bool:
    return Path(spec).is_dir() or is_recording(Path(spec))


def _is_file(spec: str) -> bool:
    """Whether it is a file, or a missing one that was surely meant to be one."""
    path = Path(spec)
    meant = bool(path.suffix) and "://" not in spec and not spec.startswith("/dev/")
    return path.is_file() or (meant and not path.exists())


_KINDS = (
    _Kind(lambda spec: spec == "sim", "allanscope.sources.simulated", "open_simulated"),
    _Kind(lambda spec: spec == "auto", "allanscope.sources.serial_port", "open_auto"),
    _Kind(_is_recording, "allanscope.sources.recorded", "open_recorded"),
    _Kind(_is_file, "allanscope.sources.file", "open_file"),
    _Kind(lambda _: True, "allanscope.sources.serial_port", "open_serial"),
)
"""In the order in which they are asked."""


def open_source(spec: str, settings: SourceSettings | None = None) -> Source:
    """Open whatever a name means.

    Parameters
    ----------
    spec : str
        ``sim``, the simulated device; ``auto``, the board that is plugged in; a recording or the
        folder of one; any other file, as a raw capture; else a serial port or a pyserial URL.
    settings : SourceSettings, optional
        How.

    Raises
    ------
    DeviceError
        If a port cannot be opened, or no board is found.
    InputError
        If a file cannot be read.
    """
    kind = next(kind for kind in _KINDS if kind.means(spec))
    opener = getattr(import_module(kind.module), kind.opener)
    source: Source = opener(spec, settings or SourceSettings())
    return source
