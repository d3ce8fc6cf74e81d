"""A port that a process of its own reads: nothing lost, nobody left behind, and a way back."""

from __future__ import annotations

import os
import select
import signal
import struct
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from allanscope.sources import SerialSource, SourceSettings
from allanscope.sources.isolated_reader import IsolatedReader
from support.pty_device import Device, read_bytes, read_until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a thread reads")

PATIENCE_S = 60.0


def eventually(true: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def gone(pid: int) -> bool:
    """Return whether a process has ended, a zombie that nobody has waited for included."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


@pytest.fixture
def apart(device: Device) -> Iterator[SerialSource]:
    """Yield a source whose port the other process has begun to read."""
    with_process = SerialSource(str(device.path), comports=list)
    eventually(lambda: with_process.read() and _link(with_process).is_reading)
    yield with_process
    with_process.close()


def _link(source: SerialSource) -> IsolatedReader:
    assert isinstance(source._link, IsolatedReader)
    return source._link


def pid_of(source: SerialSource) -> int:
    process = _link(source)._process
    assert process is not None
    return process.pid


def test_it_says_who_reads_and_at_which_priority(device: Device, apart: SerialSource) -> None:
    device.say(b"x")
    assert read_bytes(apart, 1) == b"x"
    assert apart.reader.startswith("a separate process at ")
    assert "priority" in apart.reader
    assert apart.reader.endswith("; no low-latency mode")  # a pseudo-terminal gathers nothing


@pytest.mark.parametrize(
    ("had", "granted", "said"),
    [
        ("usual priority", True, "real-time priority (SCHED_RR 10, by RealtimeKit)"),
        ("usual priority", False, "usual priority"),
        ("real-time priority (SCHED_RR 10)", True, "real-time priority (SCHED_RR 10)"),
    ],
)
def test_realtimekit_is_asked_where_the_reader_is_not_allowed_to(
    apart: SerialSource, monkeypatch: pytest.MonkeyPatch, had: str, granted: bool, said: str
) -> None:
    asked = []

    def make(process: int, priority: int) -> bool:
        asked.append((process, priority))
        return granted

    monkeypatch.setattr("allanscope.sources.isolated_reader.make_real_time", make)
    _link(apart)._start_reader_process(had)
    assert asked == ([] if had.startswith("real-time") else [(pid_of(apart), 10)])
    assert _link(apart).description == f"a separate process at {said}"


@pytest.mark.parametrize("known", [True, False])
def test_a_driver_that_gathers_bytes_is_told_not_to(
    device: Device, monkeypatch: pytest.MonkeyPatch, known: bool
) -> None:
    """As FTDI's has it, and one that takes the flag without knowing it."""
    import fcntl

    flags_at, flag = 16, 1 << 13  # linux/serial.h, linux/tty_flags.h
    state = bytearray(os.urandom(flags_at) + bytes(112))
    asked = []
    real = fcntl.ioctl

    def ioctl(fd: int, request: int, argument: bytes | int = 0, *rest: bool) -> object:
        if request == 0x541E:
            return bytes(state)
        if request != 0x541F:
            return real(fd, request, argument, *rest)
        assert isinstance(argument, bytes)
        asked.append(struct.unpack_from("i", argument, flags_at)[0])
        assert argument[:flags_at] == state[:flags_at], "nothing else is changed"
        if known:
            state[:] = argument
        return b""

    monkeypatch.setattr(fcntl, "ioctl", ioctl)
    source = SerialSource(str(device.path), SourceSettings(own_process=False), comports=list)
    device.say(b"x")
    assert read_bytes(source, 1) == b"x"
    source.close()
    assert asked == [flag]
    assert source.reader.endswith("; low latency" if known else "; no low-latency mode")


def test_bytes_are_taken_from_the_port_while_this_process_does_not_read(
    device: Device, apart: SerialSource
) -> None:
    """The kernel holds some 20 kB; ten times that can be written before this process reads."""
    sent = os.urandom(200_000)
    near = device._ends[0]
    os.set_blocking(near, False)
    left = memoryview(sent)

    def say() -> bool:
        nonlocal left
        try:
            left = left[os.write(near, left[:500]) :]
        except BlockingIOError:
            time.sleep(0.001)
        return not left

    eventually(say)
    os.set_blocking(near, True)
    written_ns = time.monotonic_ns()
    time.sleep(0.1)
    data, times = b"", []
    while len(data) < len(sent):
        chunk = apart.read()
        assert not chunk.event
        if chunk.data:
            data += chunk.data
            times.append(chunk.host_ns)
    assert data == sent
    assert times == sorted(times)
    # The times are those of the other process: most came before this one began to read.
    assert sum(at <= written_ns for at in times) > len(times) // 2


def test_no_byte_is_lost_or_swapped_while_the_other_process_takes_over(device: Device) -> None:
    for _ in range(5):
        source = SerialSource(str(device.path), comports=list)
        sent, data = b"", b""
        while not (_link(source).is_reading and len(data) == len(sent)):
            if not _link(source).is_reading:
                more = os.urandom(100)
                device.say(more)
                sent += more
            data += source.read().data
            assert len(sent) < 10_000_000
        assert data == sent
        source.close()


def test_a_reader_that_is_killed_is_replaced_by_a_thread_and_a_gap_is_told(
    device: Device, apart: SerialSource
) -> None:
    os.kill(pid_of(apart), signal.SIGKILL)
    eventually(lambda: apart.read() and not _link(apart).is_reading)
    device.say(b"after")
    chunks = read_until(apart, lambda chunk: bool(chunk.data))
    assert (chunks[-1].data, chunks[-1].event) == (b"after", "overrun")
    ended = "a thread of the measuring process, because its process has ended"
    assert apart.reader == f"{ended}; no low-latency mode"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_everybody_does_not_end_it(
    device: Device, apart: SerialSource, number: signal.Signals
) -> None:
    assert os.getpgid(pid_of(apart)) != os.getpgrp()
    os.kill(pid_of(apart), number)
    device.say(b"still here")
    assert read_bytes(apart, 10) == b"still here"


def test_closing_leaves_no_process_and_the_port_free(device: Device, apart: SerialSource) -> None:
    pid = pid_of(apart)
    apart.close()
    assert gone(pid)
    again = SerialSource(str(device.path), comports=list)
    device.say(b"again")
    assert read_bytes(again, 5) == b"again"
    again.close()


def test_unplugged_it_ends_and_the_next_one_begins(device: Device, apart: SerialSource) -> None:
    pid = pid_of(apart)
    device.say(b"last words")
    # It has read them, and they wait for us in its pipe; what the kernel holds, unplugging drops.
    eventually(lambda: select.select([_link(apart)._data], [], [], 0.0)[0])
    device.unplug()
    chunks = read_until(apart, lambda chunk: chunk.event == "disconnected")
    assert b"".join(chunk.data for chunk in chunks) == b"last words"
    assert gone(pid)
    device.plug()
    read_until(apart, lambda chunk: chunk.event == "reconnected")
    eventually(lambda: apart.read() and _link(apart).is_reading)
    apart.write(b"hello")
    assert device.heard(5) == b"hello"


def test_no_orphan_is_left_by_a_process_that_is_killed(device: Device) -> None:
    program = textwrap.dedent(
        f"""
        from allanscope.sources import SerialSource
        source = SerialSource({str(device.path)!r}, comports=list)
        while not source._link.is_reading:
            source.read()
        print(source._link._process.pid, flush=True)
        while True:
            source.read()
        """
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        pid = int(process.stdout.readline())
        assert not gone(pid)
        process.kill()
        process.wait()
        eventually(lambda: gone(pid))


@pytest.mark.parametrize("program", ["", "/nowhere/python", "/bin/false"])
def test_without_a_process_a_thread_reads_and_says_so(
    device: Device, monkeypatch: pytest.MonkeyPatch, program: str
) -> None:
    monkeypatch.setattr(sys, "executable", program)
    source = SerialSource(str(device.path), comports=list)
    device.say(b"still read")
    assert read_bytes(source, 10) == b"still read"
    eventually(lambda: source.read() and not getattr(source._link, "_process", None))
    assert source.reader.startswith("a thread of the measuring process")
    device.say(b"later too")
    assert read_bytes(source, 9) == b"later too"
    source.close()


def test_it_can_be_told_not_to(device: Device) -> None:
    source = SerialSource(str(device.path), SourceSettings(own_process=False), comports=list)
    assert not isinstance(source._link, IsolatedReader)
    source.close()
