"""Lets the Rerun viewer open our recordings.

The viewer calls every program named ``rerun-importer-*`` on the path for a file that it is to open.
One that has nothing to do with the file ends with the exit code 66, and should do so at once: a
header is read here before anything heavy is imported. Otherwise the recording is analysed like a
live session, and what a live viewer would have been shown is written to standard output.

The viewer (0.41) asks no importer about a name that ends in ``.mcap``: its own reader takes it and
shows bytes. Give the file another name, or pipe it::

    ln -s session.mcap session.allanscope && rerun --bind 127.0.0.1 session.allanscope
    rerun-importer-allanscope session.mcap | rerun --bind 127.0.0.1 -
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from allanscope.analysis import Analyser
    from allanscope.samples import Event
    from allanscope.view import RerunView

__all__ = ["NOT_OURS", "is_ours", "main"]

NOT_OURS = 66
"""Exit code for files that are somebody else's."""

_MAGIC = b"\x89MCAP0\r\n"
_HEADER = b"\x01"
_PROFILE = b"allanscope"
_ABOUT = "Write a recording of allanscope to standard output as the Rerun viewer reads it."
_SPACING = 1.12
"""The history is drawn each time that the run has grown by this factor."""


def is_ours(path: Path) -> bool:
    """Return whether a file is an MCAP whose header names our profile."""
    try:
        with path.open("rb") as file:
            head = file.read(len(_MAGIC) + 13 + len(_PROFILE))
    except OSError:
        return False
    length = len(_PROFILE).to_bytes(4, "little")
    return head.startswith(_MAGIC + _HEADER) and head.endswith(length + _PROFILE)


def main(argv: Sequence[str] | None = None) -> int:
    """Write a recording of ours to standard output the way the viewer reads it."""
    parser = argparse.ArgumentParser(prog="rerun-importer-allanscope", description=_ABOUT)
    parser.add_argument("file", type=Path)
    parser.add_argument("--application-id", default="")
    parser.add_argument("--recording-id", default="")
    options, _ = parser.parse_known_args(argv)
    if not is_ours(options.file):
        return NOT_OURS
    os.environ.setdefault("RUST_LOG", "off")
    from allanscope.errors import AllanscopeError
    from allanscope.sanitize import spell_out_standard_streams

    spell_out_standard_streams()

    try:
        _show(options.file, options.application_id, options.recording_id)
    except AllanscopeError as error:
        print(f"allanscope: {error}", file=sys.stderr)
        return int(error.exit_code)
    return 0


def _show(path: Path, application: str, identity: str) -> None:
    from allanscope.analysis import Analyser, AnalyserSettings, summarise
    from allanscope.pipeline.analyse_file import recorded_settings
    from allanscope.pipeline.decoding import Decoding
    from allanscope.pipeline.settings import DeviceSettings
    from allanscope.recording import Recording
    from allanscope.view import Canvas, RerunView

    recording = Recording(path)
    device = recorded_settings(recording, DeviceSettings())
    decoding = Decoding(device.for_wire(), device.wire)
    analyser = Analyser(AnalyserSettings(part=device.part))
    facts = {"name": path.name, "path": str(path)}
    view = RerunView(None, "none", facts)
    view.start(Canvas.to_output(facts, application, identity))
    due_s = 1.0
    for chunk in recording.chunks():
        for event in decoding.feed(chunk):
            analyser.feed(event)
            _emit(view, event, analyser)
        if (lasted_s := _duration_s(analyser)) >= due_s:
            due_s = lasted_s * _SPACING
            view.snapshot(summarise(analyser, decoding.stats, "live", facts))
            view.settle()
    for event in decoding.finish():
        analyser.feed(event)
        _emit(view, event, analyser)
    view.close(summarise(analyser, decoding.stats, "full", facts), timeout_s=60.0)


def _emit(view: RerunView, event: Event, analyser: Analyser) -> None:
    from allanscope.samples import Block, Gap, Notice, StreamInfo

    match event:
        case StreamInfo():
            view.info(event)
        case Block() if analyser.state is not None:
            view.samples(analyser.state.info, event)
        case Gap():
            view.gap(event)
        case Notice():
            view.notice(event)


def _duration_s(analyser: Analyser) -> float:
    state = analyser.state
    if state is None or not state.info.nominal_hz:
        return 0.0
    return state.samples / state.info.nominal_hz
