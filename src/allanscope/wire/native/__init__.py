"""The native protocol, host and device side; the norm is ``firmware_protocol/PROTOCOL.md``.

::

    bytes ─▶ framing (plain) ─┐                             ┌▶ StreamInfo  Block  Gap  Notice
             kernel  (batch) ─┴▶ table of frames ─▶ assembly ┘
                                                  epochs, losses, time
    Block ─▶ encoder ─▶ stuffing (many frames at once) ─▶ bytes

`layout` mirrors the numbers of the norm, `tlv` and `descriptor` say what the counts mean,
`remarks` are for people and `commands` for the device.
"""

from __future__ import annotations

from allanscope.wire.native.decoder import NativeDecoder
from allanscope.wire.native.encoder import NativeEncoder, samples_per_frame
from allanscope.wire.native.format import NativeFormat
from allanscope.wire.native.layout import Flag

__all__ = ["Flag", "NativeDecoder", "NativeEncoder", "NativeFormat", "samples_per_frame"]
