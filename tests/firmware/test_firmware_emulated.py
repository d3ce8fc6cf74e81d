"""The firmware on an emulated STM32L475, through a real serial port.

No test asserts a rate: the emulator keeps time only roughly. Contiguity, values, counters and
answers are asserted.
"""

import time

import numpy as np
import serial
from test_firmware_golden import count

from allanscope.samples import Block, Gap, Notice, StreamInfo
from allanscope.wire import format_named
from allanscope.wire.base import WireSettings
from allanscope.wire.native.framing import seal

PATIENCE_S = 60.0
START, STOP, DESCRIBE, SET, PING = 0x81, 0x82, 0x83, 0x84, 0x85


class Host:
    """A host at the board's port: decodes what comes, sends commands, keeps everything."""

    def __init__(self, board):
        self._port = serial.Serial(str(board.port), timeout=0.02, write_timeout=10)
        self._decoder = format_named("native").decoder(WireSettings())
        self.events = []
        self._seq = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._port.close()

    def send(self, kind, body=b""):
        self._seq += 1
        self._port.write(b"\0" + seal(kind, self._seq, 0, body))
        return self._seq

    def until(self, condition, what):
        """Read until something is there; the patience is only an upper bound."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, f"no {what} within {PATIENCE_S} s"
            data = self._port.read(self._port.in_waiting or 1)
            self.events += self._decoder.feed(data, time.monotonic())

    def acknowledged(self, seq):
        replies = [e for e in self.events if isinstance(e, Notice) and e.kind == "reply"]
        return [reply.fields["result"] for reply in replies if reply.fields["sequence"] == seq]

    def ask(self, kind, body=b""):
        """Send a command, again while no reply comes as the norm says, and return its result.

        What the board sends before QEMU has noticed that its port was opened is lost.
        """
        sent = [self.send(kind, body)]
        next_try = time.monotonic() + 2.0

        def answered():
            nonlocal next_try
            if time.monotonic() > next_try:
                sent.append(self.send(kind, body))
                next_try += 2.0
            return any(self.acknowledged(seq) for seq in sent)

        self.until(answered, f"reply to {kind:#x}")
        return next(result for seq in sent for result in self.acknowledged(seq))

    @property
    def blocks(self):
        return [event for event in self.events if isinstance(event, Block)]

    def samples(self):
        return sum(map(len, self.blocks))

    def lost(self):
        return sum(e.lost for e in self.events if isinstance(e, Gap) and e.lost is not None)

    def last_status(self):
        found = [e for e in self.events if isinstance(e, Notice) and e.kind == "status"]
        return found[-1].fields if found else {}


def check_values(blocks):
    """Assert that every 13th sample is what the synthetic sensor defines."""
    for block in blocks:
        for row in range(0, len(block), 13):
            expected = [count(block.index + row, axis) for axis in range(6)]
            assert block.counts[row].tolist() == expected


def test_every_sample_is_the_synthetic_sensors_and_none_is_missing(boards):
    with boards.on_pty("virtual") as board, Host(board) as host:
        host.until(lambda: host.samples() > 20_000, "20 000 samples")
        check_values(host.blocks)
        indices = np.concatenate([b.index + np.arange(len(b)) for b in host.blocks])
        np.testing.assert_array_equal(np.diff(indices), 1)
        assert host.lost() == host.last_status()["dropped"] == 0


def test_commands_are_acknowledged_in_the_middle_of_a_stream(boards):
    with boards.on_pty("paced") as board, Host(board) as host:
        assert host.ask(PING, b"\0\1\0") == 0
        assert host.ask(DESCRIBE) == 0
        assert host.ask(0x90) == 1
        assert host.ask(SET, b"\x0a\x04\x00\x00\xd0\x43") == 0
        assert host.ask(SET, b"\x05\x04\x00\x00\x40\x40") == 3
        assert host.ask(SET, b"\x05\x09") == 2
        host.until(lambda: host.samples() > 100, "samples")
        infos = [event for event in host.events if isinstance(event, StreamInfo)]
        assert [info.nominal_hz for info in infos] == [104.0, 416.0]
        seen = len(host.blocks)
        host.until(lambda: host.last_status().get("commands") == 6, "a status of the new epoch")
        assert host.lost() == host.last_status()["dropped"]
        check_values(host.blocks[seen:])


def test_stop_is_silence_and_start_is_a_new_epoch(boards):
    with boards.on_pty("paced") as board, Host(board) as host:
        host.until(lambda: host.samples() > 20, "samples")
        assert host.ask(STOP) == 0
        seen = host.samples()
        assert host.ask(PING) == 0
        assert host.samples() == seen
        assert host.ask(START) == 0
        host.until(lambda: host.samples() > seen + 20, "samples after the start")
        infos = [event for event in host.events if isinstance(event, StreamInfo)]
        assert infos[-1].epoch == (infos[0].epoch + 1) % 65536
        assert host.blocks[-1].index < 1000


def test_samples_that_find_no_room_are_dropped_and_counted_to_the_sample(boards):
    with boards.on_pty("paced") as board, Host(board) as host:
        assert host.ask(SET, b"\x0a\x04\x00\x80\xcf\x44") == 0  # 1660 Hz
        host.until(lambda: host.samples() > 200, "samples")
        for _ in range(10):  # on a busy machine the board's own clock is slow
            time.sleep(3.0)  # the host does not read: the ring of the device runs over
            after = host.samples()
            host.until(lambda: host.samples() > after + 4000, "samples after the pause")  # noqa: B023
            told = host.last_status().get("uptime_s", 0.0)
            host.until(lambda: host.last_status()["uptime_s"] > told, "a status")  # noqa: B023
            assert host.lost() == host.last_status()["dropped"]
            if host.lost():
                break
        assert host.lost() > 0
        check_values(host.blocks)


def test_a_board_that_is_restarted_is_a_new_segment_and_never_mixed(boards):
    with boards.on_pty("paced") as board:
        with Host(board) as host:
            host.until(lambda: host.samples() > 50, "samples")
        board.kill()
        board.start()
        with Host(board) as again:
            again.until(lambda: again.samples() > 50, "samples after the restart")
            assert again.blocks[0].index < 500
            check_values(again.blocks)
