"""Recording: every byte of a session, safe against crashes, full disks and bad sectors.

What is kept is what the device said, not what we understood of it: the raw bytes of every read with
the time at which they came. A replay feeds the same bytes to the same decoder, so a mistake in a
decoder never costs a night::

    Source ──Chunk──▶ Recorder ─(queue)─▶ SessionWriter ──▶ Segment ──▶ session.mcap
                      own thread           numbers, times     memory      session-001.mcap
                                           rotation           commit      ...

    session.mcap ──▶ outline ──▶ records ─▶ Recording ──▶ chunks(), buffers(), events(), tx()
                     where the   unpacked,                 │
                     records     checked                   └──▶ recover() ──▶ one sound file
                     lie

A `chunk` is one read. `recorder`, `session` and `segment` write; `outline`, `records` and `reader`
read; `recovery` saves what a damaged session still holds, and `export` writes samples as a table.
The files are plain MCAP, which other tools open; `layout` says what is in them. Written twice
a second, they lose less than a second when the process is killed. The reader uses no index, checks
every length before it uses it, skips what is corrupt, and says so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.recording.chunk import Chunk, LinkEvent
    from allanscope.recording.export import ExportReport, export_csv, export_parquet
    from allanscope.recording.layout import MCAP_MAGIC, segment_number
    from allanscope.recording.outline import Damage
    from allanscope.recording.reader import Buffer, Fingerprint, Recording, is_recording
    from allanscope.recording.recorder import Recorder
    from allanscope.recording.records import most_unpacked
    from allanscope.recording.recovery import RecoveryReport, recover
    from allanscope.recording.session import SessionWriter, write_recording

__all__ = [
    "MCAP_MAGIC",
    "Buffer",
    "Chunk",
    "Damage",
    "ExportReport",
    "Fingerprint",
    "LinkEvent",
    "Recorder",
    "Recording",
    "RecoveryReport",
    "SessionWriter",
    "export_csv",
    "export_parquet",
    "is_recording",
    "most_unpacked",
    "recover",
    "segment_number",
    "write_recording",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "Buffer": "reader",
        "Chunk": "chunk",
        "Damage": "outline",
        "ExportReport": "export",
        "Fingerprint": "reader",
        "LinkEvent": "chunk",
        "MCAP_MAGIC": "layout",
        "Recorder": "recorder",
        "Recording": "reader",
        "RecoveryReport": "recovery",
        "SessionWriter": "session",
        "export_csv": "export",
        "export_parquet": "export",
        "is_recording": "reader",
        "most_unpacked": "records",
        "recover": "recovery",
        "segment_number": "layout",
        "write_recording": "session",
    },
)
