"""Faults of a simulated device: which there are, how they are written, when and how they strike.

Some happen to bytes on the line (flipped bits, lost and repeated bytes, garbage), some are things
that the device does (stall, unplug, reset). Each comes at random with a mean rate, or once.

Every fault of bytes begins inside a frame, never at its last byte, which ends the frame in all
formats. So it destroys the frame in which it happens and no other, and what was destroyed is known
without asking any decoder. Only a loss of many bytes reaches further: when it takes the end of one
frame, it takes at least one byte of the next, which is then destroyed as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from numpy.random import Generator

from allanscope.errors import UsageError
from allanscope.simulator.parameters import Parameter, check_names, number, split_spec

__all__ = [
    "FAULT_KINDS",
    "Damage",
    "FaultKind",
    "FaultSpec",
    "LineNoise",
    "Occurrences",
    "fault_help",
    "parse_fault",
]

RATE_BYTES = Parameter("1/byte", "mean number per byte sent", 0.0, least=0.0, most=0.1)
RATE_SECONDS = Parameter("1/s", "mean number per second", 0.0, least=0.0, most=10.0)
AT = Parameter("s", "once, at this device time", -1.0)


@dataclass(frozen=True, slots=True)
class FaultKind:
    """One kind of fault.

    Attributes
    ----------
    summary : str
        One line for the help.
    where : str
        ``bytes`` for what happens to a frame on the line, ``device`` for what the device does.
    parameters : mapping
        Its numbers.
    """

    summary: str
    where: Literal["bytes", "device"]
    parameters: Mapping[str, Parameter]


_ON_BYTES = {"rate": RATE_BYTES, "at": AT}
_OF_DEVICE = {"rate": RATE_SECONDS, "at": AT}
_LENGTH = Parameter("1", "bytes", 1.0, above=0.0, most=65536.0)
_SECONDS = Parameter("s", "how long", 1.0, above=0.0)

FAULT_KINDS: Mapping[str, FaultKind] = {
    "bit_flip": FaultKind("one bit of a frame is inverted", "bytes", _ON_BYTES),
    "byte_loss": FaultKind(
        "bytes are lost, beginning inside a frame", "bytes", {**_ON_BYTES, "length": _LENGTH}
    ),
    "byte_repeat": FaultKind("one byte of a frame is sent twice", "bytes", _ON_BYTES),
    "garbage": FaultKind(
        "random bytes are inserted in a frame",
        "bytes",
        {**_ON_BYTES, "length": Parameter("1", "bytes", 32.0, above=0.0, most=65536.0)},
    ),
    "stall": FaultKind(
        "the device is silent for a while, but goes on measuring",
        "device",
        {**_OF_DEVICE, "seconds": _SECONDS},
    ),
    "unplug": FaultKind(
        "the cable is unplugged, and plugged in again",
        "device",
        {**_OF_DEVICE, "seconds": _SECONDS},
    ),
    "reset": FaultKind("the device restarts: a new epoch, counted from 0", "device", _OF_DEVICE),
}


@dataclass(frozen=True, slots=True)
class FaultSpec:
    """A fault with its numbers.

    Attributes
    ----------
    kind : str
        A name in `FAULT_KINDS`.
    rate : float
        Mean number of occurrences per byte sent (faults of bytes) or per second (of the device), at
        random.
    at : float or None
        Device time in s of one occurrence.
    length : int
        Bytes, for ``byte_loss`` and ``garbage``.
    seconds : float
        Duration, for ``stall`` and ``unplug``.
    """

    kind: str
    rate: float = 0.0
    at: float | None = None
    length: int = 1
    seconds: float = 1.0

    @property
    def on_bytes(self) -> bool:
        """Whether it happens to frames on the line, not to the device."""
        return FAULT_KINDS[self.kind].where == "bytes"


def parse_fault(text: str) -> FaultSpec:
    """Return the fault that ``KIND:rate=...,at=...`` describes.

    Raises
    ------
    UsageError
        One line that lists what exists.

    Examples
    --------
    >>> parse_fault("unplug:at=5,seconds=2")
    FaultSpec(kind='unplug', rate=0.0, at=5.0, length=1, seconds=2.0)
    """
    kind, raw = split_spec(text, "fault", FAULT_KINDS)
    where, known = f"fault {kind}", FAULT_KINDS[kind].parameters
    check_names(where, raw, known)
    if not {"rate", "at"} & set(raw):
        raise UsageError(f"{where}: say how often or when, e.g. {kind}:at=10")
    values = {
        name: number(where, name, raw.get(name, limits.default), limits)
        for name, limits in known.items()
    }
    return FaultSpec(
        kind=kind,
        rate=values["rate"],
        at=values["at"] if "at" in raw else None,
        length=int(values.get("length", 1.0)),
        seconds=values.get("seconds", 1.0),
    )


def fault_help() -> str:
    """Return one line for each kind of fault, for the help of the command line."""
    return "\n".join(
        f"{name}: {kind.summary} ({', '.join(kind.parameters)})"
        for name, kind in FAULT_KINDS.items()
    )


class Occurrences:
    """A Poisson process along any coordinate (bytes, seconds), plus one fixed point.

    Parameters
    ----------
    rate : float
        Mean number per unit of the coordinate; 0 for none.
    rng : Generator
        Draws the distances.
    at : float, optional
        A point at which one more happens.

    Examples
    --------
    >>> import numpy as np
    >>> once = Occurrences(0.0, np.random.default_rng(1), at=5.0)
    >>> once.next, once.until(4.9), once.until(5.0), once.until(9.0)
    (5.0, 0, 1, 0)
    """

    def __init__(self, rate: float, rng: Generator, at: float | None = None) -> None:
        self._rate = rate
        self._rng = rng
        self._at = math.inf if at is None else at
        self._random = self._distance()

    @property
    def next(self) -> float:
        """Where the next one is; infinity for never."""
        return min(self._at, self._random)

    def until(self, coordinate: float) -> int:
        """Return how many happen up to a coordinate that has not been asked for before."""
        count = 0
        while self.next <= coordinate:
            count += 1
            if self._at <= self._random:
                self._at = math.inf
            else:
                self._random += self._distance()
        return count

    def _distance(self) -> float:
        return float(self._rng.exponential(1.0 / self._rate)) if self._rate else math.inf


@dataclass(frozen=True, slots=True)
class Damage:
    """A frame as it left, and which faults made it so (`cause` is the first one; empty if none)."""

    data: bytes
    kinds: tuple[str, ...] = ()
    cause: str = ""


class LineNoise:
    """Damages frames.

    Parameters
    ----------
    faults : iterable of FaultSpec
        Those that happen to bytes; others are passed over.
    rng : Generator
        Where and when.
    """

    def __init__(self, faults: Iterable[FaultSpec], rng: Generator) -> None:
        self._rng = rng
        self._faults = [
            (fault, Occurrences(fault.rate, rng), Occurrences(0.0, rng, fault.at))
            for fault in faults
            if fault.on_bytes
        ]
        self._position = 0
        self._still_to_lose = 0

    def damage(self, frame: bytes, now_s: float) -> Damage:
        """Return a frame as it reaches the host's port.

        Parameters
        ----------
        frame : bytes
            As the encoder made it.
        now_s : float
            Device time.
        """
        data, kinds = bytearray(frame), []
        hit = self._continue_loss(data)
        self._position += len(frame)
        for fault, by_byte, by_time in self._faults:
            for _ in range(by_byte.until(self._position) + by_time.until(now_s)):
                if len(data) > 2:
                    self._damage_frame(fault, data)
                    kinds.append(fault.kind)
        if hit:
            return Damage(bytes(data), tuple(kinds), "byte_loss")
        harmed = bytes(data) != frame  # two flips of one bit harm nothing
        return Damage(bytes(data), tuple(kinds), kinds[0] if harmed else "")

    def end_of_line(self) -> None:
        """Forget a loss that had not come to its end: the line was cut."""
        self._still_to_lose = 0

    def _continue_loss(self, data: bytearray) -> bool:
        """Take away what a loss in an earlier frame still takes from this one."""
        if not self._still_to_lose:
            return False
        taken = min(self._still_to_lose, len(data))
        ends_frame = taken == len(data)
        del data[:taken]
        self._still_to_lose -= taken
        if ends_frame:
            self._still_to_lose = max(self._still_to_lose, 1)
        return True

    def _damage_frame(self, fault: FaultSpec, data: bytearray) -> None:
        """Damage one frame once, at a random place between its first and its last byte."""
        place = int(self._rng.integers(1, len(data) - 1))
        match fault.kind:
            case "bit_flip":
                data[place] ^= 1 << int(self._rng.integers(8))
            case "byte_repeat":
                data[place:place] = data[place : place + 1]
            case "garbage":
                data[place:place] = self._rng.bytes(fault.length)
            case "byte_loss":
                missing = fault.length - (len(data) - place)
                del data[place : place + fault.length]
                if missing >= 0:
                    self._still_to_lose = max(missing, 1)
