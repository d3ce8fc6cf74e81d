"""What every wire format provides: a decoder, an encoder, a way to be recognised and to be started.

And what the encoders share, which are simulated devices: times and temperatures of rows, and a
device that only sends (`OneWayEncoder`).

Independent of the transport: bytes go in, events come out (and the other way round
for the encoder, which the simulated device uses); whoever owns the port moves the bytes.

A night at 6.66 kHz is nine million reads. A decoder that can take many together (the native one
does) is given megabytes at a time by `feed_chunks`, and still says when each byte arrived.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import Block, Event, Origin, StreamInfo

__all__ = [
    "Command",
    "Decoder",
    "Encoder",
    "LinkStats",
    "OneWayEncoder",
    "WireFormat",
    "WireSettings",
    "answers",
    "device_times",
    "feed_chunks",
    "temperatures_at",
]


@dataclass(slots=True)
class LinkStats:
    """Counters of one link; every one of them is shown, none of them is fatal.

    Attributes
    ----------
    bytes : int
        Bytes received.
    frames : int
        Frames or records that passed every check.
    crc_errors : int
        Frames whose checksum was wrong.
    resyncs : int
        Resynchronisations: bytes discarded to find the next frame.
    unknown : int
        Sound frames of a type that this version does not know.
    suspect : int
        Rows that no check refused and their neighbours contradict, on a line that damages rows:
        left out like a damaged one, and among the lost where times or numbers tell.
    samples : int
        Samples delivered.
    lost_samples : int
        Samples known to be missing.
    unknown_losses : int
        Gaps of unknown length.
    """

    bytes: int = 0
    frames: int = 0
    crc_errors: int = 0
    resyncs: int = 0
    unknown: int = 0
    suspect: int = 0
    samples: int = 0
    lost_samples: int = 0
    unknown_losses: int = 0


@dataclass(frozen=True, slots=True)
class WireSettings:
    """What the user said about the device; None or empty where the stream itself must tell.

    Attributes
    ----------
    part : str
        Name of the part.
    rate_hz : float or None
        Nominal sample rate.
    gyro_fs, accel_fs : float or None
        Full scales in dps and g.
    units : dict
        Unit of a group of columns of delimited text, e.g. ``{"gyro": "dps"}``.
    origin : str
        Where the samples come from, for formats in which the device cannot say it.
    sensor : str
        Sensor of columns that name none, ``gyro`` or ``accel``, as the name of the file tells it.
    """

    part: str = ""
    rate_hz: float | None = None
    gyro_fs: float | None = None
    accel_fs: float | None = None
    units: dict[str, str] = field(default_factory=dict)
    origin: Origin = ""
    sensor: str = ""


class Decoder(Protocol):
    """Bytes to events. Never raises on any input, and keeps no more of it than it must.

    That is a partial frame or line; frames of an epoch without a descriptor, two seconds of them;
    and for formats without one the first 25 rows, which show what they mean (1024 of a file whose
    times come unevenly).
    """

    stats: LinkStats

    def feed(self, data: bytes, host_s: float) -> list[Event]:
        """Take bytes that arrived at host time `host_s` and return what they complete."""

    def interrupt(self, reason: str) -> list[Event]:
        """Forget a partial frame, e.g. after an unplug; the next Block follows a Gap."""

    def finish(self) -> list[Event]:
        """Return what the end of the stream completes, e.g. a last line without its newline."""


@dataclass(frozen=True, slots=True)
class Command:
    """What a host asked a device to do.

    Attributes
    ----------
    name : {'start', 'stop', 'describe', 'ping', 'set', 'unknown'}
        The request.
    sequence : int
        Number that the reply must echo, where the format has one.
    fields : dict
        What came with it: ``rate_hz``, ``gyro_fs``, ``accel_fs``, ``axes`` or raw ``payload``; and
        ``uptime_s``, when it came.
    """

    name: Literal["start", "stop", "describe", "ping", "set", "unknown"]
    sequence: int = 0
    fields: dict[str, Any] = field(default_factory=dict)


class Encoder(Protocol):
    """The device's end of the wire: events to bytes, and the host's bytes to commands."""

    silent_until_started: ClassVar[bool]
    """True when the device says nothing before it has been told to start."""

    def samples_per_frame(self, rate_hz: float) -> int:
        """Return how many samples a frame holds at a rate; 1 where each is sent by itself."""

    def describe(self, info: StreamInfo) -> bytes:
        """Return what the device sends to say what follows; empty when the format has none."""

    def encode(self, block: Block) -> bytes:
        """Return the frames of a block. Block.index may jump: that is how losses are reported."""

    def status(self, produced: int, sent: int, dropped: int, uptime_s: float) -> bytes:
        """Return the periodic status; empty when the format has none."""

    def receive(self, data: bytes) -> list[Command]:
        """Take bytes from the host and return the commands that they complete."""

    def reply(self, command: Command, ok: bool = True) -> bytes:
        """Return the answer to a command; empty when the format has none."""


class OneWayEncoder:
    """A device that only sends samples: it has no status, and whatever it is told it ignores."""

    silent_until_started: ClassVar[bool] = False

    def __init__(self, info: StreamInfo) -> None:
        self._info = info

    def samples_per_frame(self, rate_hz: float) -> int:
        """Return 1: each sample is sent by itself."""
        return 1

    def describe(self, info: StreamInfo) -> bytes:
        """Take note of the scales; the format has no words for them."""
        self._info = info
        return b""

    def status(self, produced: int, sent: int, dropped: int, uptime_s: float) -> bytes:
        """Return nothing: such a device does not know what it lost."""
        return b""

    def receive(self, data: bytes) -> list[Command]:
        """Return nothing: such a device does not listen."""
        return []

    def reply(self, command: Command, ok: bool = True) -> bytes:
        """Return nothing."""
        return b""


def device_times(block: Block, rows: NDArray[np.int64], nominal_hz: float) -> NDArray[np.float64]:
    """Return the device time of some rows of a block, in seconds.

    Interpolated between the ticks; beyond them, or without any, carried on at the nominal rate.
    """
    period = 1.0 / nominal_hz if nominal_hz else 0.0
    known = np.isfinite(block.ticks.device_s)
    if not known.any():
        return np.asarray((block.index + rows) * period, np.float64)
    offsets, seconds = block.ticks.offset[known], block.ticks.device_s[known]
    beyond = np.maximum(rows - offsets[-1], 0) + np.minimum(rows - offsets[0], 0)
    found = np.interp(rows, offsets, seconds) + beyond * period
    return np.asarray(np.maximum(found, 0.0), np.float64)


def temperatures_at(block: Block, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the temperature at some rows of a block, interpolated; NaN when it has none."""
    known = np.isfinite(block.ticks.temperature_c)
    if not known.any():
        return np.full(len(rows), np.nan)
    offsets, degrees = block.ticks.offset[known], block.ticks.temperature_c[known]
    return np.asarray(np.interp(rows, offsets, degrees), np.float64)


@dataclass(frozen=True, slots=True)
class WireFormat:
    """One entry of the registry.

    Formats are not distinguished by name: a format declares what it can do, here for all of its
    streams and in the `StreamInfo` of each stream (``numbered``, ``polled``, ``tabular``).

    Attributes
    ----------
    name : str
        As used on the command line.
    summary : str
        One line for the help.
    framed : bool
        True when samples come in frames, between others that hold none. Elsewhere what is counted
        as a frame is a row of samples.
    must_start_first : bool
        True where what a host writes in other formats puts a device out of step for good, so that
        it must be spoken to before those.
    baud : int
        Line rate of a UART that carries it, by default.
    """

    framed: ClassVar[bool] = False
    must_start_first: ClassVar[bool] = False
    baud: ClassVar[int] = 115_200

    name: str
    summary: str

    def decoder(self, settings: WireSettings) -> Decoder:
        """Return a fresh decoder."""
        raise NotImplementedError

    def encoder(self) -> Encoder:
        """Return a fresh encoder."""
        raise NotImplementedError

    def start(self, settings: WireSettings) -> list[bytes]:
        """Return what a host writes, each in a single write, to make a device stream."""
        return []

    def stop(self) -> list[bytes]:
        """Return what a host writes at the end."""
        return []

    def describe(self) -> list[bytes]:
        """Return what a host writes when a Notice with ``wanted="descriptor"`` comes."""
        return []

    def score(self, sample: bytes) -> float:
        """Return from 0 (surely not) to 1 (surely) how well a sample of a stream fits."""
        raise NotImplementedError


@runtime_checkable
class _Answers(Protocol):
    def answers(self) -> list[bytes]: ...


def answers(decoder: Decoder) -> list[bytes]:
    """Return what a host must send now because of what the decoder has been fed, once.

    A device whose protocol is a conversation is answered so; the decoders of all other formats
    never have anything to say.
    """
    return decoder.answers() if isinstance(decoder, _Answers) else []


@runtime_checkable
class _TakesChunks(Protocol):
    def feed_chunks(
        self, data: bytes, ends: NDArray[np.int64], host_s: NDArray[np.float64]
    ) -> list[Event]: ...


def feed_chunks(
    decoder: Decoder, data: bytes, ends: NDArray[np.int64], host_s: NDArray[np.float64]
) -> list[Event]:
    """Feed a decoder several chunks that arrived one after another.

    The events are those of ``decoder.feed`` called for each chunk, but that contiguous Blocks may
    come as one.

    Parameters
    ----------
    decoder : Decoder
    data : bytes
        The chunks, one after another.
    ends : ndarray of int64, shape (c,)
        Where each chunk ends in `data`, ascending; the last one is its length.
    host_s : ndarray of float64, shape (c,)
        When each chunk arrived.
    """
    if isinstance(decoder, _TakesChunks):
        return decoder.feed_chunks(data, ends, host_s)
    events: list[Event] = []
    start = 0
    for end, time in zip(ends.tolist(), host_s.tolist(), strict=True):
        events += decoder.feed(data[start:end], time)
        start = end
    return events
