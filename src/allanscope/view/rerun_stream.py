"""The recording that viewers show: where it goes, and that it never waits for anyone.

Data go to a server on the loopback interface, from which viewers fetch them, and to a file. The
other way round, connecting to a viewer, an absent or stalled viewer would sooner or later block the
log calls for ever, and stop the file as well.
"""

from __future__ import annotations

from pathlib import Path

import rerun as rr

from allanscope.errors import DeviceError
from allanscope.view.viewer_process import LOOPBACK, free_port, refuse_taken

__all__ = ["APPLICATION", "SERVER_MEMORY", "open_output", "open_stream"]

APPLICATION = "allanscope"
SERVER_MEMORY = "96MiB"
"""What the server keeps for viewers that join late; beyond it the oldest data are dropped."""

_ATTEMPTS = 5
_FLUSH_S = 5.0


def open_stream(
    name: str, file: Path | None, serve: bool, port: int | None = None
) -> tuple[rr.RecordingStream, str]:
    """Return a recording, and the address of its server or an empty text.

    Parameters
    ----------
    name : str
        Of the recording, shown to people.
    file : Path or None
        Also written to this file; without the footer, whose index would grow in memory all night.
    serve : bool
        Also served to viewers.
    port : int, optional
        Where it is served; any free port if not given.

    Raises
    ------
    DeviceError
        When no port of the loopback interface can be had.
    UsageError
        When the port that was given is taken.
    """
    if serve and port is not None:
        refuse_taken(port)
    for _ in range(_ATTEMPTS):
        recording = rr.RecordingStream(APPLICATION)
        recording.set_log_time_enabled(False)
        server = _server(port or free_port()) if serve else None
        sinks: list[rr.GrpcServerSink | rr.FileSink] = [] if server is None else [server]
        if file is not None:
            sinks.append(rr.FileSink(str(file), write_footer=False))
        recording.set_sinks(*sinks)
        recording.send_recording_name(name)
        try:
            # Rerun reports that a port is taken, by whoever was faster, only when flushing.
            recording.flush(timeout_sec=_FLUSH_S)
        except Exception:
            recording.disconnect()
        else:
            return recording, "" if server is None else str(server.uri)
    raise DeviceError("the viewer finds no free port on 127.0.0.1; use --view none")


def open_output(name: str, application: str = "", identity: str = "") -> rr.RecordingStream:
    """Return a recording that goes to standard output.

    Parameters
    ----------
    name : str
        Of the recording, shown to people.
    application, identity : str
        Names under which the reading viewer wants it; empty for our own.
    """
    recording = rr.RecordingStream(application or APPLICATION, recording_id=identity or None)
    recording.set_log_time_enabled(False)
    recording.stdout()
    recording.send_recording_name(name)
    return recording


def _server(port: int) -> rr.GrpcServerSink:
    return rr.GrpcServerSink(bind_ip=LOOPBACK, port=port, server_memory_limit=SERVER_MEMORY)
