"""TMsg, the protocol between ST's evaluation boards and ST's desktop tools.

::

    bytes ─▶ messages ─▶ pairing of sensors ─▶ milli (mdps, mg to counts) ─▶ rows (losses, Blocks)

A board is silent until `messages.start` wakes it. Messages have an 8-bit sum and no number: losses
are told by the time stamps.
"""

from __future__ import annotations

from dataclasses import dataclass

from allanscope.wire.base import WireFormat, WireSettings
from allanscope.wire.tmsg import messages
from allanscope.wire.tmsg.decoder import TMsgDecoder
from allanscope.wire.tmsg.encoder import SensorTileEncoder, TMsgEncoder
from allanscope.wire.tmsg.messages import Unwrapper, read_current, read_sensortile

__all__ = ["SensorTileEncoder", "TMsgDecoder", "TMsgEncoder", "TMsgFormat", "TMsgSensorTileFormat"]


@dataclass(frozen=True, slots=True)
class TMsgFormat(WireFormat):
    """What Nucleo boards with X-CUBE-MEMS1 DataLogExtended send to ST's own tools."""

    name: str = "tmsg"
    summary: str = "binary protocol of ST's DataLogExtended firmware (Unicleo-GUI, MEMS-Studio)"
    sensortile: bool = False

    def decoder(self, settings: WireSettings) -> TMsgDecoder:
        """Return a fresh decoder."""
        return TMsgDecoder(settings, self.sensortile)

    def encoder(self) -> TMsgEncoder:
        """Return a fresh encoder."""
        return SensorTileEncoder() if self.sensortile else TMsgEncoder()

    def start(self, settings: WireSettings) -> list[bytes]:
        """Choose the sensors, set what the user asked for, and start."""
        return messages.start(settings, index=not self.sensortile)

    def stop(self) -> list[bytes]:
        """End the stream."""
        return messages.stop()

    def score(self, sample: bytes) -> float:
        """Return 1 for two streaming messages of this layout, 0.7 for one, else 0."""
        read = read_sensortile if self.sensortile else read_current
        messages = (body for body in Unwrapper().feed(sample) if body is not None)
        found = sum(read(body) is not None for body in messages)
        return (0.0, 0.7, 1.0)[min(found, 2)]


@dataclass(frozen=True, slots=True)
class TMsgSensorTileFormat(TMsgFormat):
    """What a SensorTile with DataLogExtended 4.3.0 sends."""

    name: str = "tmsg-sensortile"
    summary: str = "the same in the fixed layout of the SensorTile's DataLogExtended 4.3.0"
    sensortile: bool = True
