"""The device's end of the native protocol, fast enough to simulate a night in seconds."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import AXES, INT16_MAX, INT16_MIN, Block, StreamInfo
from allanscope.wire.base import Command, device_times, temperatures_at
from allanscope.wire.native import descriptor
from allanscope.wire.native.framing import Deframer, pack_data_frames, pack_frame
from allanscope.wire.native.layout import (
    DATA_HEADER,
    NO_TEMPERATURE,
    NO_TICKS,
    VERSION,
    Flag,
    FrameType,
    Result,
)
from allanscope.wire.native.messages import EVENT_HEAD, REPLY_HEAD, STATUS, command_of

__all__ = ["NativeEncoder"]

_LONGEST_WAIT_S = 0.02
_USUAL_SAMPLES = 16
_TICKS_PER_S = 40_000


class NativeEncoder:
    """Events to bytes of the native protocol, and the host's bytes to commands.

    Attributes
    ----------
    flags : Flag
        Flags to raise in the next data frame, e.g. `Flag.SENSOR_OVERRUN` before a jump of the
        index that the sensor caused.
    """

    silent_until_started: ClassVar[bool] = False

    def __init__(self) -> None:
        self.flags = Flag(0)
        self._seq = 0
        self._info = StreamInfo(AXES, (8.75e-3,) * 3 + (0.061e-3,) * 3)
        self._next_index: int | None = None
        self._deframer = Deframer()
        self._received = 0

    def samples_per_frame(self, rate_hz: float) -> int:
        """Return how many samples a device puts in a frame: 16, or what 20 ms bring.

        >>> [NativeEncoder().samples_per_frame(rate) for rate in (26, 104, 416, 6660)]
        [1, 3, 9, 16]
        """
        return max(1, min(_USUAL_SAMPLES, 1 + int(rate_hz * _LONGEST_WAIT_S)))

    def describe(self, info: StreamInfo) -> bytes:
        """Return the descriptor of what follows, after a zero that ends any truncated frame."""
        if info.epoch != self._info.epoch:
            self._next_index = None
        self._info = info
        return b"\0" + self._frame(FrameType.DESCRIPTOR, descriptor.write(info))

    def encode(self, block: Block) -> bytes:
        """Return the data frames of a block.

        Parameters
        ----------
        block : Block
            Counts in the columns of the StreamInfo described last; what exceeds int16 is clipped
            and flagged, as in a sensor. Each frame takes its time and temperature from the ticks,
            interpolated and, beyond the last one, carried on at the nominal rate.
        """
        if len(block) == 0:
            return b""
        samples, saturated = self._samples(block.counts)
        size = self.samples_per_frame(self._info.nominal_hz)
        starts = np.arange(0, len(block), size)
        headers = self._headers(block, starts, size, saturated)
        if self._next_index is not None and block.index != self._next_index:
            headers["flags"][0] |= Flag.DROPPED_BEFORE
        headers["flags"][0] |= self.flags
        self.flags = Flag(0)
        self._next_index = block.index + len(block)
        self._seq += len(starts)
        full = len(block) // size
        return pack_data_frames(headers[:full], samples[: full * size]) + pack_data_frames(
            headers[full:], samples[full * size :]
        )

    def status(self, produced: int, sent: int, dropped: int, uptime_s: float) -> bytes:
        """Return the status that goes out once a second."""
        bad = self._deframer.crc_errors + self._deframer.malformed
        counters = (produced, sent, dropped, 0, self._received, bad)
        body = STATUS.pack(round(uptime_s * 1e6), *(n & 0xFFFFFFFF for n in counters))
        return self._frame(FrameType.STATUS, body)

    def event(self, text: str, uptime_s: float, level: int = 0) -> bytes:
        """Return a line of text for the user; level 0 is a remark, 1 a warning, 2 an error."""
        body = EVENT_HEAD.pack(round(uptime_s * 1e6), level) + text.encode("utf-8")[:200]
        return self._frame(FrameType.EVENT, body)

    def receive(self, data: bytes) -> list[Command]:
        """Take bytes from the host and return the commands that they complete."""
        commands = [
            command_of(frame)
            for frame, _ in self._deframer.feed(data)
            if frame[0] >= FrameType.START
        ]
        self._received += len(commands)
        return commands

    def reply(self, command: Command, ok: bool = True) -> bytes:
        """Return the answer to a command."""
        result = Result.OK if ok else Result.FAILED
        if command.name == "unknown":
            result = Result.UNKNOWN_COMMAND
        payload = b""
        if command.name == "ping":
            uptime_us = round(command.fields.get("uptime_s", 0.0) * 1e6)
            payload = command.fields.get("payload", b"") + uptime_us.to_bytes(8, "little")
        kind = int(command.fields.get("type", 0))
        body = REPLY_HEAD.pack(command.sequence & 0xFFFF, kind, result) + payload
        return self._frame(FrameType.REPLY, body)

    def _frame(self, kind: FrameType, body: bytes) -> bytes:
        frame = pack_frame(kind, self._seq, self._info.epoch, body)
        self._seq += 1
        return frame

    def _samples(self, counts: NDArray[np.generic]) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
        """Return counts in all six columns, and the saturation flags of each sample."""
        wide = np.zeros((len(counts), len(AXES)), np.int16)
        columns = [AXES.index(axis) for axis in self._info.axes]
        wide[:, columns] = np.clip(np.rint(counts), INT16_MIN, INT16_MAX)
        ends = (wide == INT16_MIN) | (wide == INT16_MAX)
        flags = ends[:, :3].any(axis=1) * np.uint8(Flag.GYRO_SATURATED)
        return wide, flags | ends[:, 3:].any(axis=1) * np.uint8(Flag.ACCEL_SATURATED)

    def _headers(
        self, block: Block, starts: NDArray[np.int64], size: int, saturated: NDArray[np.uint8]
    ) -> NDArray[np.void]:
        headers = np.zeros(len(starts), DATA_HEADER)
        headers["type"] = FrameType.DATA
        headers["version"] = VERSION
        headers["seq"] = (self._seq + np.arange(len(starts))) & 0xFFFF
        headers["epoch"] = self._info.epoch & 0xFFFF
        valid = descriptor.valid_flags(descriptor.channels_of(self._info.axes))
        headers["flags"] = valid | np.bitwise_or.reduceat(saturated, starts)
        headers["n"] = np.minimum(len(block) - starts, size)
        headers["index"] = (block.index + starts) & 0xFFFFFFFF
        seconds = device_times(block, starts, self._info.nominal_hz)
        headers["mcu_us"] = np.rint(seconds * 1e6)
        headers["sensor_ticks"] = np.rint(seconds * _TICKS_PER_S).astype(np.int64) % NO_TICKS
        headers["temperature"] = self._temperatures(block, starts)
        return headers

    def _temperatures(self, block: Block, starts: NDArray[np.int64]) -> NDArray[np.int16]:
        degrees = temperatures_at(block, starts) - descriptor.ZERO_COUNTS_C
        counts = np.rint(degrees * descriptor.counts_per_degree(self._info.part))
        known = np.clip(np.nan_to_num(counts), NO_TEMPERATURE + 1, INT16_MAX)
        return np.where(np.isnan(degrees), NO_TEMPERATURE, known).astype(np.int16)
