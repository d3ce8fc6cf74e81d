"""However a session is ended, what it leaves behind is the same; if it is killed, it goes on."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from allanscope.errors import InputError
from allanscope.pipeline import DeviceSettings, analyse_input
from allanscope.recording import Recording
from support.device_process import DeviceProcess
from support.live_session import watch_in_full
from support.survey import missing, survey

Plug = Callable[..., DeviceProcess]

SESSIONS = Path(__file__).with_name("sessions_process.py")
QUICK = {"rate": 104.0, "axes": ["gz"]}
"""One axis: what is left behind costs a sixth of what it does for six."""

SCHEDULING_S = 3.0
"""What a busy machine may add to the half second after which all is on the disk."""

LEFT = ["report.html", "result.json", "session.mcap", "session.rrd"]


@contextmanager
def sessions(url: str, folder: Path, count: int) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, str(SESSIONS), url, str(folder), str(count)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        try:
            yield child
        finally:
            child.kill()


def test_each_signal_ends_a_session_as_its_time_would(plug_in: Plug, tmp_path: Path) -> None:
    """Ctrl-C, SIGTERM and SIGHUP one after another in one process, then it ends by itself: 0."""
    device = plug_in(QUICK)
    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
    with sessions(device.url, tmp_path, len(numbers)) as child:
        assert child.stdout is not None
        for number, each in enumerate(numbers):
            assert child.stdout.readline() == "watching\n"
            child.send_signal(each)
            samples = int(child.stdout.readline().split()[1])
            folder = tmp_path / f"S{number}"
            assert sorted(path.name for path in folder.iterdir()) == LEFT
            assert json.loads((folder / "result.json").read_text())["samples"] == samples > 50
            recording = Recording(folder)
            assert recording.damage == []
            assert sum(one.received for one in survey(folder)) == samples
        assert child.wait(60.0) == 0


def test_a_killed_session_goes_on_as_one(plug_in: Plug, tmp_path: Path) -> None:
    """The result after a resumption is that of one pass over all that was ever recorded.

    The port need not be named again: it is where the session had it.
    """
    device = plug_in(QUICK)
    with sessions(device.url, tmp_path, 1) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "watching\n"
        child.kill()
    folder = tmp_path / "S0"
    (before,) = survey(folder)
    analysis = watch_in_full("auto", None, 2.5, resume=folder)
    (ledger,) = device.ledgers()
    assert sorted(path.name for path in folder.iterdir()) == [
        *LEFT[:2], "session-001.mcap", "session-before-001.rrd", *LEFT[2:]
    ]  # fmt: skip
    assert analysis.segments == 2
    assert analysis.samples > before.received > 50
    # The board was never switched off, so its numbers tell what was missed in between: what it
    # could not send, and what the process had read but not yet written when it was killed.
    (both,) = survey(folder)
    assert analysis.unknown_losses == 0
    assert analysis.samples == both.received
    assert analysis.samples + analysis.lost_samples == both.stop - both.first
    unsent = missing(ledger, both)
    assert unsent <= analysis.lost_samples <= unsent + 104 * (1.0 + SCHEDULING_S)
    again = analyse_input(folder, DeviceSettings(), quiet=True).to_dict()
    once = analysis.to_dict()
    for name, axis in again["axes"].items():
        assert once["axes"][name]["curves"] == axis["curves"]
    for key in ("samples", "segments", "rate", "link", "temperature", "lost_samples", "duration_s"):
        assert once[key] == again[key], key


def test_there_must_be_something_to_resume(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="contains no recording"):
        watch_in_full("sim", None, 1.0, resume=tmp_path)
