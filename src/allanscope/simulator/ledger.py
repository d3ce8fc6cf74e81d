"""The device's book: every sample it made, and what became of those that did not arrive."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

__all__ = ["Ledger", "Loss"]

DROPPED_BY_DEVICE = ("ring full", "no host")


@dataclass(frozen=True, slots=True)
class Loss:
    """A run of samples that never reached the host in one piece.

    Attributes
    ----------
    epoch : int
        Epoch in which they were counted.
    first, count : int
        Index of the first, and how many.
    cause : str
        ``ring full`` and ``no host`` (the device never sent them), ``unplug``, ``reset``, or the
        kind of the fault that damaged their frame.
    """

    epoch: int
    first: int
    count: int
    cause: str


class Ledger:
    """Exact counts of what the device did. Every number only grows.

    Attributes
    ----------
    produced : int
        Samples made since power-up.
    sent : int
        Samples of which at least one byte was given to the line, damaged ones included.
    losses : list of Loss
        In the order in which they happened, neighbours of one cause joined. Losses to
        ``ring full`` and ``no host`` are what the status frame calls dropped.
    lost : Counter
        Samples by cause.
    faults : Counter
        Faults that happened by kind, those that hit no sample included.
    bytes_sent : int
        Bytes given to the line.
    commands : int
        Commands obeyed or refused.
    """

    def __init__(self) -> None:
        self.produced = 0
        self.sent = 0
        self.losses: list[Loss] = []
        self.lost: Counter[str] = Counter()
        self.faults: Counter[str] = Counter()
        self.bytes_sent = 0
        self.commands = 0

    @property
    def dropped(self) -> int:
        """Samples that the device itself threw away; it reports this number to the host."""
        return sum(self.lost[cause] for cause in DROPPED_BY_DEVICE)

    @property
    def damaged(self) -> int:
        """Samples that were given to the line but could not arrive in one piece."""
        return self.lost.total() - self.dropped

    def lose(self, epoch: int, first: int, count: int, cause: str) -> None:
        """Note that samples will not arrive."""
        self.lost[cause] += count
        last = self.losses[-1] if self.losses else None
        if last and (last.epoch, last.cause, last.first + last.count) == (epoch, cause, first):
            self.losses[-1] = Loss(epoch, last.first, last.count + count, cause)
        else:
            self.losses.append(Loss(epoch, first, count, cause))

    def missing(self, epoch: int, first: int, stop: int) -> int:
        """Return how many samples of an epoch with first <= index < stop did not arrive."""
        return sum(
            max(0, min(loss.first + loss.count, stop) - max(loss.first, first))
            for loss in self.losses
            if loss.epoch == epoch
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the whole book as plain numbers, for JSON."""
        return {
            "produced": self.produced,
            "sent": self.sent,
            "dropped": self.dropped,
            "bytes_sent": self.bytes_sent,
            "commands": self.commands,
            "faults": dict(self.faults),
            "lost": dict(self.lost),
            "losses": [asdict(loss) for loss in self.losses],
        }
