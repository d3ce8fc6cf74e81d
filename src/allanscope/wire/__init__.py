"""The wire: bytes to events and back, independent of the transport.

::

    bytes ──▶ decoder.feed(data, host_s) ──▶ [StreamInfo, Block, Gap, Notice, ...]
    bytes ◀── encoder.encode(block) ◀── Block          (the simulated device)

Every format is one entry of a registry and provides the same five things (`WireFormat`): a decoder,
an encoder, what to write to start and stop a device, and a score by which it is recognised.
A decoder never raises, whatever it is fed, and never holds more than it must; what it throws away
it counts in its `LinkStats`.

============================= ======================================================================
``native/``                   numbered frames with a CRC: losses to the sample, from the numbers
``tmsg/`` ``datalog``         stock ST firmware: losses from time stamps, counts from milli-units
``sdatalog/``                 ST's firmware of today: a conversation, and counts with time stamps
``text/``                     tables and labelled lines from anywhere
``rows`` ``row_events``       what those without numbers share: rows of values, and rows to events
``continuity``                what is missing between two rows, as far as time stamps tell
``plausibility``              rows that a damaged line has altered
``timestamps`` ``lines``      wrapping counters, what time stamps show; line ends
``milli_units``               the milli-units of stock firmware, and counts again
``base`` ``registry``         what a format has, and what simulated devices share; all formats
============================= ======================================================================

`feed_chunks` feeds a decoder many reads at once, as a replay does; `answers` are what a host must
send back, where a protocol is a conversation.
"""

from __future__ import annotations

from allanscope.wire.base import (
    Command,
    Decoder,
    Encoder,
    LinkStats,
    WireFormat,
    WireSettings,
    answers,
    feed_chunks,
)
from allanscope.wire.registry import SniffResult, format_named, formats, sniff

__all__ = [
    "Command",
    "Decoder",
    "Encoder",
    "LinkStats",
    "SniffResult",
    "WireFormat",
    "WireSettings",
    "answers",
    "feed_chunks",
    "format_named",
    "formats",
    "sniff",
]
