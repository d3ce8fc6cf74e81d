"""The metadata record: what a recording says about itself, with a seal that shows rot.

MCAP protects chunks by a checksum but not metadata records, and a part name that one flipped bit
has changed into another would be believed. The record therefore carries a CRC-32 of its own.
"""

from __future__ import annotations

import json
import platform
import zlib
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version

__all__ = ["circumstances", "is_sound", "sealed"]

SEAL = "crc32"


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
    plain = {key: _encodable(value) for key, value in metadata.items() if key != SEAL}
    return {**plain, SEAL: _checksum(plain)}


def is_sound(metadata: Mapping[str, str]) -> bool:
    """Return whether the metadata is what was written."""
    plain = {key: value for key, value in metadata.items() if key != SEAL}
    return metadata.get(SEAL) == _checksum(plain)


def _encodable(value: object) -> str:
    """Text without lone surrogates, which paths may hold and UTF-8 may not."""
    return str(value).encode("utf-8", "replace").decode()


def _checksum(plain: Mapping[str, str]) -> str:
    return f"{zlib.crc32(json.dumps(plain, sort_keys=True).encode()):08x}"
