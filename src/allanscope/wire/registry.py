"""All wire formats by name, each imported when it is first asked for, and which one a port sends.

Each format scores a sample of the bytes, from 0 (surely not) to 1 (surely); the best one wins
if it is good enough (`sniff`). Two seconds are enough, with garbage before and half a frame at
either end. Where none fits, the user is shown what the port said, escaped.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module

from allanscope.errors import UsageError
from allanscope.sanitize import excerpt
from allanscope.wire.base import WireFormat

__all__ = ["SniffResult", "format_named", "formats", "sniff"]

_FORMATS: dict[str, tuple[str, str]] = {
    "native": ("allanscope.wire.native", "NativeFormat"),
    "sdatalog": ("allanscope.wire.sdatalog", "SDatalogFormat"),
    "tmsg": ("allanscope.wire.tmsg", "TMsgFormat"),
    "tmsg-sensortile": ("allanscope.wire.tmsg", "TMsgSensorTileFormat"),
    "datalog": ("allanscope.wire.datalog", "DataLogFormat"),
    "datalog11": ("allanscope.wire.datalog", "DataLog1Format"),
    "text": ("allanscope.wire.text", "TextFormat"),
}
_GOOD_ENOUGH = 0.5
_LONGEST_SAMPLE = 1 << 18


def formats() -> tuple[str, ...]:
    """Return the names of all formats, those with the strongest check first."""
    return tuple(_FORMATS)


def format_named(name: str) -> WireFormat:
    """Return a format by its name.

    Raises
    ------
    UsageError
        If there is none; the message lists all.

    Examples
    --------
    >>> format_named("native").name
    'native'
    """
    if name not in _FORMATS:
        raise UsageError(f"unknown wire format {name!r}; choose one of {', '.join(_FORMATS)}")
    module, cls = _FORMATS[name]
    made: WireFormat = getattr(import_module(module), cls)()
    return made


@dataclass(frozen=True, slots=True)
class SniffResult:
    """What a sample of bytes seems to be.

    Attributes
    ----------
    name : str or None
        The format, or None when none fits.
    scores : dict
        Score of every format.
    excerpt : str
        The beginning of the sample, escaped and printable.
    """

    name: str | None
    scores: dict[str, float]
    excerpt: str


def sniff(sample: bytes) -> SniffResult:
    """Decide which format the first seconds of a stream are in.

    Parameters
    ----------
    sample : bytes
        The bytes; of more than 256 KiB only the beginning is looked at.
    """
    sample = sample[:_LONGEST_SAMPLE]
    scores = {name: format_named(name).score(sample) for name in formats()}
    best = max(scores, key=lambda name: scores[name])
    return SniffResult(best if scores[best] >= _GOOD_ENOUGH else None, scores, excerpt(sample))
