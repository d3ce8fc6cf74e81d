"""Faults that a simulated device is to have, and how they are written on the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from allanscope.errors import UsageError
from allanscope.simulator.grammar import Parameter, check_names, number, split_spec

__all__ = ["FAULT_KINDS", "FaultKind", "FaultSpec", "fault_help", "parse_fault"]

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
    "byte_repeat": FaultKind("one byte of a frame comes twice", "bytes", _ON_BYTES),
    "garbage": FaultKind(
        "random bytes come in the middle of a frame",
        "bytes",
        {**_ON_BYTES, "length": Parameter("1", "bytes", 32.0, above=0.0, most=65536.0)},
    ),
    "stall": FaultKind(
        "the device is silent for a while, but goes on measuring",
        "device",
        {**_OF_DEVICE, "seconds": _SECONDS},
    ),
    "unplug": FaultKind(
        "the cable is pulled, and put back later",
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
