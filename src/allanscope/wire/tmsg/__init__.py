"""TMsg, the protocol between ST's evaluation boards and ST's desktop tools.

::

    bytes ─▶ framing ─▶ layouts ─▶ pairing ─▶ milli (mdps, mg to counts) ─▶ rows (losses, Blocks)

A board is silent until `requests.start` wakes it. Messages have an 8-bit sum and no number: losses
are told by the time stamps.
"""

from __future__ import annotations

from allanscope.wire.tmsg.decoder import TMsgDecoder
from allanscope.wire.tmsg.encoder import SensorTileEncoder, TMsgEncoder
from allanscope.wire.tmsg.format import TMsgFormat, TMsgSensorTileFormat

__all__ = ["SensorTileEncoder", "TMsgDecoder", "TMsgEncoder", "TMsgFormat", "TMsgSensorTileFormat"]
