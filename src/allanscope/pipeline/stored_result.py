"""The coefficients of a session from its ``result.json``, while that is up to date."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from allanscope import __version__
from allanscope.noise import Coefficient

__all__ = ["StoredResult", "stored_result"]


@dataclass(frozen=True, slots=True)
class StoredResult:
    """What an export needs of a result.

    Attributes
    ----------
    coefficients : mapping
        Axis name to coefficient name to coefficient.
    rate_hz : float
        Measured sample rate, else the nominal one.
    part : str
        Empty if it is not known.
    duration_s : float
        Length of the run.
    """

    coefficients: Mapping[str, Mapping[str, Coefficient]]
    rate_hz: float
    part: str
    duration_s: float


def stored_result(folder: Path) -> StoredResult | None:
    """Return what the result in a session folder says; None where a new analysis is needed.

    It is used only if this version of allanscope wrote it, after the last byte of every recording
    in the folder.
    """
    path = folder / "result.json"
    try:
        written = path.stat().st_mtime_ns
        if any(one.stat().st_mtime_ns > written for one in folder.glob("*.mcap")):
            return None
        result = json.loads(path.read_text("utf-8"))
        if result["allanscope"] != __version__:
            return None
        fields = ("value", "lower", "upper", "unit", "detected", "wait_s")
        rate = result["rate"]
        return StoredResult(
            {
                name: {
                    letter: Coefficient(*(one[field] for field in fields))
                    for letter, one in axis["coefficients"].items()
                }
                for name, axis in result["axes"].items()
            },
            float(rate["measured_hz"] or rate["nominal_hz"]),
            result["part"],
            float(result["duration_s"]),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
