"""DataLog, the text that ST's SensorTile sends out of the box.

::

    bytes ─▶ lines ─▶ grammar (records) ─▶ milli (mdps, mg to counts) ─▶ rows (losses, Blocks)

It has no number, no checksum and no scale: losses are told by the time stamps, and the counts of
the gyroscope are had back from its integer mdps.
"""

from __future__ import annotations

from allanscope.wire.datalog.decoder import DataLogDecoder
from allanscope.wire.datalog.encoder import DataLogEncoder
from allanscope.wire.datalog.format import DataLog1Format, DataLogFormat

__all__ = ["DataLog1Format", "DataLogDecoder", "DataLogEncoder", "DataLogFormat"]
