"""What a device or a file says of itself is shown, and can do nothing else."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from allanscope.__main__ import main
from allanscope.pipeline import Decoding, DeviceSettings, analyse_input, write_json, write_report
from allanscope.pipeline.outputs import new_session_folder, session_folder
from allanscope.pipeline.replaying import events_of
from allanscope.recording import Chunk, write_recording
from allanscope.samples import Block, Gap, Notice, StreamInfo
from allanscope.simulator import Simulator
from allanscope.view import TerminalView
from allanscope.wire import WireSettings
from allanscope.wire.native.encoder import NativeEncoder

EVIL = "<script>alert(1)</script>\x1b[2J\x1b]0;owned\x07\r\n\u202e{{7*7}}"


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.seen: set[str] = set()
        self.handlers: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.add(tag)
        self.handlers += [name for name, _ in attrs if name.startswith("on")]


@pytest.fixture(scope="module")
def evil(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of a device, and with metadata, that try everything."""
    encoder = NativeEncoder()
    sensor = Simulator(rate=104.0, axes=("gz",))
    info = replace(sensor.info, part="<u>LSM", details={"firmware": EVIL, "board": EVIL}, epoch=7)
    said = [encoder.describe(info), encoder.event(EVIL, 0.5, 2)]
    said += [encoder.encode(sensor.read(10)) for _ in range(40)]
    chunks = [Chunk(1 + n * 100_000_000, data) for n, data in enumerate(said)]
    facts = {"name": EVIL, "manufacturer": EVIL, "model": EVIL, "serial_number": EVIL}
    path = tmp_path_factory.mktemp("evil") / f"evil{EVIL.replace('/', '')}.mcap"
    return write_recording(path, chunks, facts)


def test_nothing_a_device_says_becomes_html(evil: Path, tmp_path: Path) -> None:
    analysis = analyse_input(evil, DeviceSettings(), quiet=True)
    analysis = replace(analysis, input={**analysis.input, "board": EVIL, "product": EVIL})
    write_report(analysis, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    tags = Tags()
    tags.feed(text)
    assert not tags.seen & {"script", "u", "iframe", "object", "embed", "img"}
    assert tags.handlers == []
    assert "alert(1)" in text, "it is shown, as text"
    assert all(char.isprintable() or char == "\n" for char in text)
    write_json(analysis, tmp_path / "result.json")
    assert json.loads((tmp_path / "result.json").read_text())["schema"] == "allanscope/1"


def test_nothing_a_device_says_commands_the_terminal(evil: Path) -> None:
    page = io.StringIO()
    terminal = TerminalView("plain", stream=page)
    info: StreamInfo | None = None
    for event in events_of(evil, Decoding(WireSettings()), True, ""):
        match event:
            case StreamInfo():
                info = event
                terminal.info(event)
            case Block():
                assert info is not None
                terminal.samples(info, event)
            case Gap():
                terminal.gap(event)
            case Notice():
                terminal.notice(event)
    terminal.snapshot(analyse_input(evil, DeviceSettings(), quiet=True))
    terminal.close()
    shown = page.getvalue()
    assert "alert(1)" in shown
    assert all(char.isprintable() or char == "\n" for char in shown)


@pytest.mark.parametrize("command", [["analyse", "--quiet"], ["check", "--against", "no\x1b[2J"]])
def test_names_in_errors_command_no_terminal(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command, "missing\x1b[2J\r\n.mcap"]) == 3
    out, err = capsys.readouterr()
    assert out == ""
    assert err.endswith("\n")
    assert err[:-1].isprintable()


@pytest.mark.parametrize(
    "device",
    ["../../etc/passwd", "/dev/serial/by-id/usb-ST_../..", "..", "", EVIL, "C:\\con", "a" * 500],
)
def test_a_folder_named_after_a_device_stays_where_it_is(
    device: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = session_folder(new_session_folder(device))
    assert folder.resolve().parent == tmp_path.resolve()
    assert re.fullmatch(r"session-\d{8}-\d{6}-[A-Za-z0-9-]{1,24}", folder.name)
    shutil.rmtree(folder)
    assert os.listdir(tmp_path) == []
