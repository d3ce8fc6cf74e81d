"""The transmitter of a device: a bounded ring, faults, bytes on their way, and what was lost.

::

    messages ──▶ Ring (bounded) ──▶ faults damage some ──▶ bytes written, in flight ──▶ host

A message is what the encoder made in one call: a frame of samples, or anything else. The
transmitter knows which samples are in which bytes, so whatever happens to bytes can be told in
samples.

The `Ledger` counts every sample that the device made, and what became of those that did not arrive.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import asdict, dataclass
from typing import Any

from allanscope.simulator.faults import LineNoise

__all__ = ["Ledger", "Loss", "Message", "Ring", "Transmitter"]

RESERVE_BYTES = 4096
"""Room in the ring that only replies take, so that they fit into a full ring."""
WRITE_BYTES = 4096
IN_FLIGHT_BYTES = 1 << 20
"""More than any port holds of bytes that the host has not read."""


@dataclass(frozen=True, slots=True)
class Message:
    """What the encoder made in one call, and which samples it holds (`count` 0: none)."""

    data: bytes
    epoch: int = 0
    first: int = 0
    count: int = 0


class Ring:
    """Messages that wait to be sent, at most `capacity` bytes of samples.

    Parameters
    ----------
    capacity : int
        Bytes.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._messages: deque[Message] = deque()
        self._largest = 0
        self.bytes = 0
        self.samples = 0

    def has_room(self) -> bool:
        """Return whether another frame of samples, or a report, may be made."""
        return self.bytes + self._largest <= self._capacity

    def has_reserve(self) -> bool:
        """Return whether a reply may be made."""
        return self.bytes <= self._capacity + RESERVE_BYTES

    def push(self, message: Message) -> None:
        """Append a message."""
        self._messages.append(message)
        self.bytes += len(message.data)
        self.samples += message.count
        if message.count:
            self._largest = max(self._largest, len(message.data))

    def pop(self) -> Message | None:
        """Remove and return the oldest message; None when there is none."""
        if not self._messages:
            return None
        message = self._messages.popleft()
        self.bytes -= len(message.data)
        self.samples -= message.count
        return message


class Transmitter:
    """Takes messages out of the ring, damages some, and knows where each one is.

    Parameters
    ----------
    ring : Ring
        What is to be sent.
    noise : LineNoise
        What happens to it.
    ledger : Ledger
        Where it is written down.
    """

    def __init__(self, ring: Ring, noise: LineNoise, ledger: Ledger) -> None:
        self._ring = ring
        self._noise = noise
        self._ledger = ledger
        self._out = bytearray()
        self._loaded = 0
        self._in_flight: deque[tuple[int, Message]] = deque()

    def next_bytes(self, now_s: float) -> bytes:
        """Return what is to be written next, 4096 bytes at most."""
        while len(self._out) < WRITE_BYTES and (message := self._ring.pop()) is not None:
            # What happens once at a given time is to happen to samples, not to a status.
            damage = self._noise.damage(message.data, now_s if message.count else -math.inf)
            self._out += damage.data
            self._loaded += len(damage.data)
            self._ledger.sent += message.count
            self._ledger.faults.update(damage.kinds)
            if not message.count:
                continue
            if damage.cause:
                self._ledger.lose(message.epoch, message.first, message.count, damage.cause)
            else:
                self._in_flight.append((self._loaded, message))
        return bytes(self._out[:WRITE_BYTES])

    def written(self, n: int) -> None:
        """Note that the port took the first `n` of those bytes."""
        del self._out[:n]
        self._ledger.bytes_sent += n
        arrived = self._loaded - len(self._out) - IN_FLIGHT_BYTES
        while self._in_flight and self._in_flight[0][0] <= arrived:
            self._in_flight.popleft()

    def cut(self, unread: int, cause: str, waiting: str) -> None:
        """Lose everything that the host has not read, and everything that waits.

        Parameters
        ----------
        unread : int
            How many of the written bytes were still in the port.
        cause : str
            What to write down for samples of which a part was sent.
        waiting : str
            What to write down for those that never left the ring.
        """
        read = self._loaded - len(self._out) - unread
        for end, message in self._in_flight:
            if end > read:
                self._ledger.lose(message.epoch, message.first, message.count, cause)
        self._in_flight.clear()
        self._out.clear()
        while (waited := self._ring.pop()) is not None:
            if waited.count:
                self._ledger.lose(waited.epoch, waited.first, waited.count, waiting)
        self._noise.end_of_line()


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
