"""Sources: where bytes come from, and when they came.

::

    open_source("auto") ──▶ SerialSource ──┐
    open_source("sim")  ──▶ simulated      ├──▶ read() ──▶ Chunk(host_ns, data, event)
    open_source("iio")  ──▶ IioSource ─────┤
    open_source("a.mcap") ▶ RecordedSource │
    open_source("a.csv") ─▶ FileSource   ──┘

A source knows nothing of samples. It gives chunks: the bytes of one read, the host's monotonic time
at which they came, and what happened to the link before them. One thread reads; any thread may
write or close. A serial port that disconnects comes back by itself (`serial_port`), because a night
on the bench outlives a loose cable. `discovery` finds the board by its USB numbers, `transport`
opens the link, and an `isolated_reader` has it read by a process of its own (`port_reader`), at
real-time priority where `rtkit` grants it.

A new kind of source is a file with a class that has the members of `Source`, and two lines in
`base`: which names mean it, and how it is opened.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from allanscope.lazy import lazily
from allanscope.sources.base import Chunk, LinkEvent, Source, SourceSettings

if TYPE_CHECKING:
    from allanscope.sources.base import open_file, open_source, require_port
    from allanscope.sources.discovery import (
        PortDescription,
        auto_port,
        describe_ports,
        find_ports,
    )
    from allanscope.sources.file import FileSource, RecordedSource
    from allanscope.sources.iio import (
        AXIS_NAMES,
        TIME,
        IioSource,
        ScanElement,
        ScanLayout,
        pair,
        part_name,
        period_of,
        scale_of,
    )
    from allanscope.sources.isolated_reader import buffers, may_run_in_real_time
    from allanscope.sources.serial_port import SerialSource
    from allanscope.sources.simulated import SimulatedSource

__all__ = [
    "AXIS_NAMES",
    "TIME",
    "Chunk",
    "FileSource",
    "IioSource",
    "LinkEvent",
    "PortDescription",
    "RecordedSource",
    "ScanElement",
    "ScanLayout",
    "SerialSource",
    "SimulatedSource",
    "Source",
    "SourceSettings",
    "auto_port",
    "buffers",
    "describe_ports",
    "find_ports",
    "may_run_in_real_time",
    "open_file",
    "open_source",
    "pair",
    "part_name",
    "period_of",
    "require_port",
    "scale_of",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "AXIS_NAMES": "iio",
        "FileSource": "file",
        "IioSource": "iio",
        "PortDescription": "discovery",
        "RecordedSource": "file",
        "ScanElement": "iio",
        "ScanLayout": "iio",
        "SerialSource": "serial_port",
        "SimulatedSource": "simulated",
        "TIME": "iio",
        "auto_port": "discovery",
        "buffers": "isolated_reader",
        "describe_ports": "discovery",
        "find_ports": "discovery",
        "may_run_in_real_time": "isolated_reader",
        "require_port": "base",
        "open_file": "base",
        "open_source": "base",
        "pair": "iio",
        "part_name": "iio",
        "period_of": "iio",
        "scale_of": "iio",
    },
)
