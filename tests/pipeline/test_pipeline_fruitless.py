"""A real port that goes on sending bytes, but no samples, or that is read late."""

import contextlib
import fcntl
import json
import os
import sys
import termios
import threading
import time
import tty

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.pipeline import Decoding
from allanscope.pipeline.read_queue import joined
from allanscope.samples import AXES, Block, Gap, Notice, StreamInfo, Ticks
from allanscope.sources import Chunk
from allanscope.wire import WireSettings
from allanscope.wire.native import NativeEncoder

RATE, FRAME = 416.0, 9
INFO = StreamInfo(AXES, (8.75e-3,) * 3 + (0.061e-3,) * 3, RATE, "LSM6DSM", "native", 1e-6, True, 7)
pytestmark = pytest.mark.usefixtures("undrawn")

SAID = "bytes arrive, but nothing could be decoded for 3 s"


def frame(encoder, number):
    """Return one data frame; its device times are those of a crystal."""
    rng = np.random.default_rng(number)
    at = number * FRAME
    ticks = Ticks(np.array([0]), np.array([at / RATE]), np.array([np.nan]), np.array([25.0]))
    return encoder.encode(Block(at, rng.normal(0, 20, (FRAME, 6)).astype(np.int16), ticks))


class Board:
    """Something at the other end of a pty that writes what a schedule says, and when.

    Parameters
    ----------
    schedule : iterable of (seconds, bytes)
        Ascending times since the start.
    """

    def __init__(self, schedule):
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._schedule = schedule
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._write)

    def _write(self):
        # The time of the schedule begins when the host has begun to read: opening throws away what
        # waits, and only then is the second byte taken.
        for _ in range(2):
            os.write(self._master, b"\0")
            while self._waiting():
                if self._ended.wait(0.01):
                    return
        began = time.monotonic()
        for due_s, data in self._schedule:
            if self._ended.wait(max(0.0, began + due_s - time.monotonic())):
                return
            with contextlib.suppress(BlockingIOError):
                os.read(self._master, 4096)  # what the host asks for is not answered
            self._write_all(data)

    def _write_all(self, data):
        """Write, however late the host is."""
        while data and not self._ended.is_set():
            try:
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                self._ended.wait(0.005)

    def _waiting(self):
        """Return how many bytes the host has not taken."""
        return int.from_bytes(fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4)), sys.byteorder)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)


def watched(schedule, seconds, folder, capsys):
    """Return the result of a live session at a board, and what the terminal said."""
    with Board(schedule) as board:
        command = ["live", board.port, "--for", f"{seconds}s", "--view", "none"]
        status = main([*command, "--out", str(folder), "--wire", "native"])
    said = capsys.readouterr()
    path = folder / "result.json"
    return status, json.loads(path.read_text()) if path.exists() else None, said.out + said.err


def samples(until_s, described=True):
    """Yield a device that streams for so long, in real time."""
    encoder = NativeEncoder()
    for number in range(int(until_s * RATE / FRAME)):
        start_messages = encoder.describe(INFO) if described and number % 10 == 0 else b""
        yield (number + 1) * FRAME / RATE, start_messages + frame(encoder, number)


def garbage(from_s, until_s):
    """Yield bytes that are no frames, fifty times a second."""
    rng = np.random.default_rng(3)
    for step in range(int((until_s - from_s) * 50)):
        yield from_s + step / 50, rng.integers(0, 256, 120, np.uint8).tobytes()


def test_garbage_after_a_good_start_is_said_and_its_loss_is_unknown(tmp_path, capsys):
    def schedule():
        yield from samples(4.0)
        yield from garbage(4.0, 60.0)

    status, result, said = watched(schedule(), 16, tmp_path / "a", capsys)
    assert status == 0, said
    assert said.count(SAID) >= 1
    assert result["unknown_losses"] == 1
    assert any(SAID in remark for remark in result["remarks"])


def test_a_stream_that_never_describes_itself_is_said(tmp_path, capsys):
    status, _, said = watched(samples(60.0, described=False), 8, tmp_path / "a", capsys)
    assert SAID in said
    assert "no descriptor says what they mean" in said
    assert status == 4


def test_a_slow_catching_up_after_a_stall_does_not_make_the_rate(tmp_path, capsys):
    def schedule():
        yield from samples(3.0)
        encoder = NativeEncoder()
        first = int(3.0 * RATE / FRAME)
        yield 5.9, encoder.describe(INFO)
        for number in range(first, 2000):
            yield 6.0 + (number - first) * FRAME / 736.0, frame(encoder, number)

    status, result, said = watched(schedule(), 13, tmp_path / "a", capsys)
    assert status == 0, said
    rate = result["rate"]
    assert rate["measured_hz"] == pytest.approx(RATE, rel=1e-4)
    assert rate["source"] == "device"
    assert "the rate is that of the device's clock" in said


def feed(decoding, schedule):
    """Return the events of reads at exact times."""
    events = []
    for due_s, data in schedule:
        events += decoding.feed(Chunk(1 + round(due_s * 1e9), data))
    return events + decoding.finish()


def told(events):
    return [e.text for e in events if isinstance(e, Notice) and SAID in e.text]


def test_it_is_said_once_and_again_only_after_samples_have_come():
    def schedule():
        encoder = NativeEncoder()
        yield 0.0, encoder.describe(INFO)
        for number in range(40):
            yield 0.1 + number * 0.02, frame(encoder, number)
        yield from garbage(1.0, 11.0)
        yield 11.0, b"\0" + frame(encoder, 60)
        yield from garbage(11.1, 19.0)

    events = feed(Decoding(WireSettings(), "native", lambda _: None), schedule())
    assert len(told(events)) == 2
    gaps = [event for event in events if isinstance(event, Gap)]
    assert [gap.lost for gap in gaps] == [180, None]


@pytest.mark.parametrize("every_s", [0.5, 2.5, 10.0])
def test_a_slow_table_is_not_taken_for_garbage(every_s):
    rows = ((n * every_s, b"%d,%d,1\n" % (n * every_s * 1000, n % 7)) for n in range(60))
    header = [(0.0, b"t[ms],gx[mdps],gy[mdps]\n")]
    events = feed(Decoding(WireSettings(), "text", lambda _: None), [*header, *rows])
    assert told(events) == []
    assert sum(len(event) for event in events if isinstance(event, Block)) == 60


@pytest.mark.parametrize("together", [1, 7, 1000])
def test_a_replay_says_of_its_end_what_the_live_session_said(together):
    def schedule():
        encoder = NativeEncoder()
        yield 0.0, encoder.describe(INFO)
        for number in range(40):
            yield 0.1 + number * 0.02, frame(encoder, number)
        yield from garbage(1.0, 6.0)

    reads = [Chunk(1 + round(due_s * 1e9), data) for due_s, data in schedule()]
    decoding, events = Decoding(WireSettings(), "native"), []
    for start in range(0, len(reads), together):
        for one in joined(reads[start : start + together]):
            events += decoding.feed_buffer(one)
    events += decoding.finish()
    assert len(told(events)) == 1
    assert [event for event in events if isinstance(event, Gap)] == [Gap("link", None)]
