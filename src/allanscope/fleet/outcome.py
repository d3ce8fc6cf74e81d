"""What one recording came to: its result and what it lacks, or the one line that says why none."""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import Any

from allanscope.pipeline import DeviceSettings
from allanscope.quantities import counted, number

__all__ = ["Loss", "Outcome", "compressed_result", "loss_of", "result_key", "result_of_bytes"]

FORMAT = 1
"""Raised when what is kept of a recording changes, so that results of old are not taken for new."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a worker says of one recording.

    Attributes
    ----------
    url : str
        Which.
    sha256 : str
        Fingerprint of its bytes and times; empty when it could not be read.
    files : tuple of str
        Names of the files that make it up.
    result : bytes
        The result as compressed JSON (see `compressed_result`); empty without one.
    error : str
        One line, for a recording without a result.
    version : str
        Of the allanscope that made this, where it was made.
    """

    url: str
    sha256: str = ""
    files: tuple[str, ...] = ()
    result: bytes = b""
    error: str = ""
    version: str = field(default_factory=lambda: version("allanscope"))

    @property
    def is_of_this_version(self) -> bool:
        """Whether it was made by the allanscope that asks; that of a worker may be another."""
        # What an older one pickled has no version at all.
        return getattr(self, "version", "") == version("allanscope")


def result_key(sha256: str, device: DeviceSettings) -> str:
    """Return the name of a result: content, settings and version decide, not name and place.

    >>> result_key("00", DeviceSettings()) == result_key("00", DeviceSettings(part="LSM6DSL"))
    False
    """
    what = {
        "format": FORMAT,
        "allanscope": version("allanscope"),
        "sha256": sha256,
        "device": asdict(device),
    }
    return hashlib.sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()


def compressed_result(result: dict[str, Any]) -> bytes:
    """Return a result as compressed JSON; the same result gives the same bytes."""
    text = json.dumps(result, allow_nan=False, separators=(",", ":"))
    return gzip.compress(text.encode(), compresslevel=4, mtime=0)


def result_of_bytes(data: bytes) -> dict[str, Any]:
    """Return the result that `compressed_result` has compressed.

    Raises
    ------
    ValueError
        If it is damaged.
    """
    try:
        result = json.loads(gzip.decompress(data))
    except (OSError, EOFError, ValueError) as error:
        raise ValueError(f"a stored result is damaged: {error}") from None
    if not isinstance(result, dict):
        raise ValueError("a stored result is damaged: it is no JSON object")
    return result


@dataclass(frozen=True, slots=True)
class Loss:
    """What one recording lacks.

    Attributes
    ----------
    url : str
        Which.
    samples, lost : int
        That it has, and that are known to be missing.
    unknown : int
        Gaps of unknown length.
    damaged : int
        Places where the file is damaged.
    """

    url: str
    samples: int
    lost: int
    unknown: int
    damaged: int

    @property
    def share(self) -> float:
        """Lost samples over all that there should be."""
        return self.lost / max(self.samples + self.lost, 1)

    def __str__(self) -> str:
        """Return one line.

        >>> str(Loss("night.mcap", samples=500, lost=500, unknown=0, damaged=1))
        'night.mcap: 500 samples lost (50 %), 1 damaged place'
        """
        parts = []
        if self.lost:
            percent = number(100.0 * self.share, 2)
            parts.append(f"{counted(self.lost, 'sample')} lost ({percent} %)")
        if self.unknown:
            parts.append(f"{counted(self.unknown, 'gap')} of unknown length")
        if self.damaged:
            parts.append(counted(self.damaged, "damaged place"))
        return f"{self.url}: {', '.join(parts)}"


def loss_of(url: str, kept: Mapping[str, Any]) -> Loss | None:
    """Return what a recording lacks by its result; None when it is complete."""
    analysis = kept["analysis"]
    loss = Loss(
        url,
        int(analysis["samples"]),
        int(analysis["lost_samples"] or 0),
        int(analysis["unknown_losses"] or 0),
        int(kept["circumstances"].get("damaged_places") or 0),
    )
    return loss if loss.lost or loss.unknown or loss.damaged else None
