"""The types that cross rooms: what a stream is, a run of samples, a gap, a remark.

A decoder turns bytes into these four and nothing else::

    StreamInfo   Block  Block  Block   Gap   Block  Block   StreamInfo  Block ...
    what follows  contiguous samples   gap   contiguous ...  new configuration

Two Blocks with nothing between them are contiguous: the second starts with the sample after the
last one of the first. Wherever that does not hold there is a Gap between them. A StreamInfo always
starts a new segment, because counts before it have another scale or clock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "AXES",
    "INT16_MAX",
    "INT16_MIN",
    "Block",
    "Event",
    "Gap",
    "Notice",
    "Origin",
    "StreamInfo",
    "Ticks",
    "unit_of",
]

AXES = ("gx", "gy", "gz", "ax", "ay", "az")
"""All axes in the order in which every table, chart and file lists them."""


INT16_MIN, INT16_MAX = -(1 << 15), (1 << 15) - 1
"""Least and largest count of these parts: at either end a sample says only `at least this much`."""


Origin = Literal["", "measured", "synthetic", "emulated"]
"""Where samples come from: a physical part, a program that computes them, an emulated device; empty
where nothing says so."""


def unit_of(axis: str) -> str:
    """Return the physical unit of an axis: ``dps`` for a gyro axis, ``g`` for an accelerometer's.

    >>> unit_of("gx"), unit_of("az")
    ('dps', 'g')
    """
    return "dps" if axis.startswith("g") else "g"


@dataclass(frozen=True, slots=True)
class StreamInfo:
    """What the samples that follow mean.

    Attributes
    ----------
    axes : tuple of str
        Names of the columns of every Block, a subset of `AXES` in that order.
    scale : tuple of float
        Physical unit per count for each column: dps for gyro axes, g for accelerometer axes.
    nominal_hz : float
        Sample rate that the device claims; 0.0 when it claims none. These parts are off by several
        per cent, so the measured rate replaces it as soon as it is known.
    rate_claimed : bool
        False when `nominal_hz` was read off the times of the samples: then there is no nominal rate
        to compare the measured one with.
    part : str
        Name in `allanscope.parts`, or empty when unknown.
    wire : str
        Name of the wire format that brought it.
    time_resolution_s : float
        Step of the device time in `Ticks.device_s`; 0.0 when there is no device time.
    device_clock : bool
        True when the device time is a clock of its own, such as a crystal (worth comparing with the
        host's), False when it is the sensor's own oscillator, an RC oscillator or is absent.
    epoch : int
        Changes with every restart or new configuration of the device.
    truncated : tuple of bool
        For each column, whether the sender rounded the value towards zero after scaling (stock ST
        firmware does, to 1 mg), so that the step and not the sensor limits small noise.
    details : mapping
        Anything else the device said about itself (firmware, unique id, registers): shown and
        recorded, never interpreted.
    origin : {'', 'measured', 'synthetic', 'emulated'}
        Where the samples come from, as the device says.
    numbered : bool
        True when samples carry their numbers: what is missing is known even without times.
    polled : bool
        True when firmware reads the sensor by a timer of its own, so that rows may repeat samples
        or skip them, and the rate of the rows need not be one that the sensor can be set to.
    tabular : bool
        True for rows of a table: the times in it may be anybody's, and are no crystal's.
    """

    axes: tuple[str, ...]
    scale: tuple[float, ...]
    nominal_hz: float = 0.0
    part: str = ""
    wire: str = ""
    time_resolution_s: float = 0.0
    device_clock: bool = False
    epoch: int = 0
    truncated: tuple[bool, ...] = ()
    details: Mapping[str, str] = field(default_factory=dict)
    rate_claimed: bool = True
    origin: Origin = ""
    numbered: bool = False
    polled: bool = False
    tabular: bool = False

    @property
    def configuration(self) -> tuple[tuple[str, ...], tuple[float, ...], float]:
        """Axes, scales and nominal rate: counts may be added as long as these are the same."""
        return self.axes, self.scale, self.nominal_hz

    def __post_init__(self) -> None:
        unknown = [axis for axis in self.axes if axis not in AXES]
        if unknown:
            raise ValueError(f"unknown axis {unknown[0]!r}; axes are {' '.join(AXES)}")
        if len(self.scale) != len(self.axes):
            raise ValueError(f"{len(self.axes)} axes need as many scales, got {len(self.scale)}")
        # NaN never equals itself: a stream that is described again would be another one each time.
        if not all(map(math.isfinite, (*self.scale, self.nominal_hz))):
            raise ValueError("scales and rate must be finite numbers")


@dataclass(frozen=True, slots=True)
class Ticks:
    """Time and temperature at some of the samples of a Block (one row a frame or a text record).

    Attributes
    ----------
    offset : ndarray of int64, shape (t,)
        Row of the Block that each tick belongs to, ascending.
    device_s : ndarray of float64, shape (t,)
        Device time of that row, in seconds, unwrapped; NaN where the device gave none.
    host_s : ndarray of float64, shape (t,)
        Host monotonic time at which the bytes arrived, in seconds; NaN when read from a file
        that holds none.
    temperature_c : ndarray of float64, shape (t,)
        Temperature in degC; NaN where none came.
    """

    offset: NDArray[np.int64]
    device_s: NDArray[np.float64]
    host_s: NDArray[np.float64]
    temperature_c: NDArray[np.float64]

    @classmethod
    def none(cls) -> Ticks:
        """Return an empty table, for a Block that came without any time."""
        empty = np.empty(0)
        return cls(np.empty(0, np.int64), empty, empty, empty)


@dataclass(frozen=True, slots=True)
class Block:
    """A run of contiguous samples.

    Attributes
    ----------
    index : int
        Number of the first sample since the device started, counting samples that were lost where
        the device says so; else the number of samples received before.
    counts : ndarray of int16, int32 or float64, shape (n, k)
        Samples, one column for each axis of the StreamInfo in force. Multiply by its scale.
    ticks : Ticks
        Times and temperatures, sparse.
    """

    index: int
    counts: NDArray[Any]
    ticks: Ticks

    def __len__(self) -> int:
        return int(self.counts.shape[0])


@dataclass(frozen=True, slots=True)
class Gap:
    """A gap: what came before and what comes after are not neighbours.

    Attributes
    ----------
    reason : str
        Why, in the words of `GapReason`.
    lost : int or None
        Number of missing samples; None when unknown.
    """

    reason: GapReason
    lost: int | None


GapReason = Literal[
    "link",  # frames were damaged or lost on the way
    "device",  # the device dropped them: its own buffer was full
    "sensor",  # the sensor's FIFO overran
    "disconnected",  # the port disconnected and came back
    "restarted",  # the device was reset or reconfigured
    "stalled",  # no data for a while although the port is open
    "resumed",  # the session was continued after a crash or a pause
    "file",  # bytes missing in the file that was read
]


@dataclass(frozen=True, slots=True)
class Notice:
    """Something that is no sample: a status, a reply to a command, a line of text.

    Attributes
    ----------
    kind : {'status', 'reply', 'text', 'error', 'mark', 'event'}
        What sort of remark it is.
    text : str
        One printable line; control characters have been removed.
    fields : mapping
        Numbers that came with it, e.g. ``produced``, ``sent`` and ``dropped`` of a status; ``host``
        where it is no remark of the device but this program's own, and ``assumed`` where that is
        what a stream did not say and the result rests on.
    """

    kind: Literal["status", "reply", "text", "error", "mark", "event"]
    text: str
    fields: Mapping[str, int | float | str] = field(default_factory=dict)


Event = StreamInfo | Block | Gap | Notice
"""All that a decoder says."""
