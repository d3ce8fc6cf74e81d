"""What happens to bytes on the line: flipped bits, lost and repeated bytes, garbage.

Every fault begins inside a frame, never at its last byte, which ends the frame in all formats. So
it destroys the frame in which it happens and no other, and what was destroyed is known without
asking any decoder. Only a loss of many bytes reaches further: when it takes the end of one frame,
it takes at least one byte of the next, which is then destroyed as well.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from numpy.random import Generator

from allanscope.simulator.fault_spec import FaultSpec
from allanscope.simulator.occurrences import Occurrences

__all__ = ["Damage", "LineNoise"]


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
                    self._strike(fault, data)
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

    def _strike(self, fault: FaultSpec, data: bytearray) -> None:
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
