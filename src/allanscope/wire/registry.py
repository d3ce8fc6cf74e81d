"""All wire formats by name, each imported when it is first asked for."""

from __future__ import annotations

from importlib import import_module

from allanscope.errors import UsageError
from allanscope.wire.base import WireFormat

__all__ = ["format_named", "formats"]

_FORMATS: dict[str, tuple[str, str]] = {
    "native": ("allanscope.wire.native", "NativeFormat"),
    "tmsg": ("allanscope.wire.tmsg", "TMsgFormat"),
    "tmsg-sensortile": ("allanscope.wire.tmsg", "TMsgSensorTileFormat"),
    "datalog": ("allanscope.wire.datalog", "DataLogFormat"),
    "datalog11": ("allanscope.wire.datalog", "DataLog1Format"),
    "text": ("allanscope.wire.text", "TextFormat"),
}


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
