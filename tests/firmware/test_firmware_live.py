"""The emulated SensorTile under `allanscope live`, as a user runs it: a process at a serial port.

Everything that counts is asserted and nothing that depends on how fast the emulator is. The loss
equation holds in each test: samples that are missing by their index are what the device says that
it dropped.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.pipeline import Decoding
from allanscope.recording import Recording
from allanscope.samples import Block, Gap, Notice
from allanscope.wire import WireSettings
from support.emulated_host import DESCRIBE, SET, STOP, Host
from support.emulator import Patience
from support.synthetic_sensor import check_values

PROGRAM = [sys.executable, "-m", "allanscope"]


class Live:
    """`allanscope live` at a board's port, in a process of its own.

    Parameters
    ----------
    board : Board
        Whose port is read.
    out : Path
        Folder of the session.
    """

    def __init__(self, board, out):
        self.out, self._board = out, board
        command = [*PROGRAM, "live", str(board.port), "--view", "none", "--out", str(out), "--json"]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True)

    def recorded(self):
        """Return how many bytes are on the disk."""
        return sum(path.stat().st_size for path in self.out.glob("*.mcap"))

    def wait_for_bytes(self, more):
        """Wait until so many more bytes are recorded."""
        goal, patience = self.recorded() + more, self._board.patience()
        while self.recorded() < goal:
            assert self.process.poll() is None, self.process.stderr.read()
            assert not patience.ended(), "nothing more is recorded"
            time.sleep(0.05)

    def hold_up(self, seconds):
        """Stop the session for a while, its reader included: alone it would lose nothing."""
        tasks = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        held = [self.process.pid, *(int(pid) for task in tasks for pid in task.read_text().split())]
        for one in held:
            os.kill(one, signal.SIGSTOP)
        time.sleep(seconds)
        for one in reversed(held):
            os.kill(one, signal.SIGCONT)

    def end(self):
        """Ctrl-C; return the printed result and the events that the recording holds."""
        self.process.send_signal(signal.SIGINT)
        said, complaint = self.process.communicate()
        assert self.process.returncode == 0, complaint
        decoding, events = Decoding(WireSettings()), []
        for chunk in Recording(self.out).chunks():
            events += decoding.feed(chunk)
        return json.loads(said), events + decoding.finish()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.communicate()


def indices(events):
    """Return the index of every sample that came."""
    blocks = [event for event in events if isinstance(event, Block)]
    return np.concatenate([block.index + np.arange(len(block)) for block in blocks])


def replies(events):
    return [event for event in events if isinstance(event, Notice) and event.kind == "reply"]


def statuses(events):
    """Return what the board told of its counters, in order."""
    told = [event.fields for event in events if isinstance(event, Notice)]
    return [fields for fields in told if "dropped" in fields]


def booked(events):
    """Return for each status what it says was dropped, the losses told before it, and the next one.

    The last is what may be dropped already: the next frame of samples tells of it.
    """
    lost, rows = 0, []
    for event in events:
        if isinstance(event, Gap):
            rows = [
                (dropped, seen, event.lost if after is None else after)
                for dropped, seen, after in rows
            ]
            lost += event.lost
        elif isinstance(event, Notice) and "dropped" in event.fields:
            rows.append((event.fields["dropped"], lost, None))
    return [(dropped, seen, after or 0) for dropped, seen, after in rows]


def test_live_records_and_decodes_a_board_that_loses_power_and_stops_it_at_the_end(
    boards, tmp_path
):
    with boards.on_pty("paced") as board, Live(board, tmp_path / "session") as live:
        live.wait_for_bytes(6_000)
        board.kill()
        time.sleep(1.0)
        board.start()
        live.wait_for_bytes(6_000)
        result, events = live.end()
        assert result["input"]["wire"] == "native"
        assert (result["part"], result["rate"]["nominal_hz"]) == ("LSM6DSM", 104.0)
        assert (result["segments"], result["link"]["reconnects"]) == (2, 1)
        assert (result["lost_samples"], result["unknown_losses"]) == (0, 1)
        assert [e.reason for e in events if isinstance(e, Gap)] == ["disconnected"]
        seen = indices(events)
        assert result["samples"] == len(seen)
        (restart,) = np.flatnonzero(np.diff(seen) != 1) + 1
        assert seen[restart] < seen[restart - 1]  # the board counts from zero again
        check_values([event for event in events if isinstance(event, Block)])
        assert {one["dropped"] for one in statuses(events)} == {0}
        assert [one.fields["result"] for one in replies(events)].count(0) >= 2  # to the new start
        with Host(board) as host:
            # The session has told the board to stop: it answers, and sends nothing else.
            assert host.ask(DESCRIBE) == 0
            assert host.samples() == 0


def test_a_session_that_is_held_up_accounts_for_every_sample_that_the_board_dropped(
    boards, tmp_path
):
    with boards.on_pty("paced") as board:
        with Host(board) as host:
            assert host.ask(SET, b"\x0a\x04\x00\x80\xcf\x44") == 0  # 1660 Hz
            assert host.ask(STOP) == 0
        with Live(board, tmp_path / "session") as live:  # which starts a silent board
            live.wait_for_bytes(10_000)
            live.hold_up(5.0)
            live.wait_for_bytes(30_000)
            result, events = live.end()
        gaps = [event for event in events if isinstance(event, Gap)]
        assert {gap.reason for gap in gaps} == {"device"}
        assert result["lost_samples"] == sum(gap.lost for gap in gaps) > 0
        told = [one for one in booked(events) if one[0] > 0]
        assert told, "a status after the loss"
        for dropped, seen_lost, next_lost in told:
            assert seen_lost <= dropped <= seen_lost + next_lost
        assert result["unknown_losses"] == result["link"]["crc_errors"] == 0
        seen = indices(events)
        assert seen[0] == 0
        assert seen[-1] + 1 == result["samples"] + result["lost_samples"]
        check_values([event for event in events if isinstance(event, Block)])


def test_the_emulated_device_of_the_command_line_is_this_board(boards, tmp_path):
    link = tmp_path / "ttySensorTile0"
    command = [*PROGRAM, "device", "--emulated", "--link", str(link)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as device:
        try:
            assert device.stdout.readline().strip() == str(link)
            board = SimpleNamespace(port=link, patience=lambda: Patience(device))
            with Host(board) as host:
                host.until(lambda: host.samples() > 100, "samples")
                check_values(host.blocks)
                assert host.lost() == 0
        finally:
            device.send_signal(signal.SIGTERM)
    assert device.returncode == 0
    assert not link.is_symlink()


@pytest.mark.parametrize("option", ["--wire=tmsg", "--fault=stall:at=1", "--effect=step:time=1"])
def test_the_emulated_device_refuses_what_only_the_simulated_one_can_do(option, capsys):
    assert main(["device", "--emulated", option]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "leave out --emulated" in said
