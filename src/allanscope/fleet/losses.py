"""Recordings that are not complete: what the terminal says of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from allanscope.quantities import count, number

__all__ = ["Loss", "loss_of"]


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
            parts.append(f"{count(self.lost)} samples lost ({percent} %)")
        if self.unknown:
            parts.append(f"{self.unknown} gap{'s' * (self.unknown > 1)} of unknown length")
        if self.damaged:
            parts.append(f"{self.damaged} damaged place{'s' * (self.damaged > 1)}")
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
