"""The serial source on real pseudo-terminals: reading, unplugging, hanging, closing."""

from __future__ import annotations

import errno
import itertools
import os
import socket
import subprocess
import termios
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from allanscope.errors import DeviceError, UsageError
from allanscope.sources import SerialSource, SourceSettings, open_source
from allanscope.sources.transport import Transport
from support.pty_device import Device, read_bytes, read_until


def test_every_byte_arrives_in_order_and_times_ascend(device: Device, source: SerialSource) -> None:
    sent = os.urandom(200_000)
    feeder = threading.Thread(target=feed, args=(device, sent), daemon=True)
    feeder.start()
    assert read_bytes(source, len(sent)) == sent
    feeder.join()
    chunks = []
    device.say(b"a")
    chunks += read_until(source, lambda chunk: chunk.data == b"a")
    device.say(b"b")
    chunks += read_until(source, lambda chunk: chunk.data == b"b")
    assert chunks[0].host_ns < chunks[1].host_ns <= time.monotonic_ns()


def feed(device: Device, data: bytes) -> None:
    for start in range(0, len(data), 500):
        device.say(data[start : start + 500])


def test_silence_is_an_empty_chunk(source: SerialSource) -> None:
    chunk = source.read()
    assert (chunk.data, chunk.event) == (b"", "")


def test_what_is_written_reaches_the_device(device: Device, source: SerialSource) -> None:
    source.write(b"\x00start\xff\r\n")
    assert device.heard(9) == b"\x00start\xff\r\n"


def test_a_device_that_goes_and_comes_back_under_its_path_goes_on(
    device: Device, source: SerialSource
) -> None:
    device.say(b"before")
    read_until(source, lambda chunk: chunk.data == b"before")
    for round_trip in range(3):
        device.unplug()
        chunks = read_until(source, lambda chunk: chunk.event == "disconnected")
        assert all(not chunk.data for chunk in chunks)
        source.write(b"into the void")
        assert source.read().event == ""
        device.plug()
        read_until(source, lambda chunk: chunk.event == "reconnected")
        assert source.trouble == ""
        device.say(b"after %d" % round_trip)
        assert read_bytes(source, 7) == b"after %d" % round_trip
        source.write(b"again")
        assert device.heard(5) == b"again"


def test_what_is_wrong_while_waiting_can_be_shown(device: Device, source: SerialSource) -> None:
    device.unplug()
    read_until(source, lambda chunk: chunk.event == "disconnected")
    read_until(source, lambda _: bool(source.trouble))
    assert source.trouble.startswith(f"no such port {device.path}")


def test_patience_can_end(device: Device) -> None:
    source = SerialSource(str(device.path), SourceSettings(give_up_s=0.01), comports=list)
    device.unplug()
    read_until(source, lambda chunk: chunk.event == "disconnected")
    with pytest.raises(DeviceError, match=r"has been disconnected for 0\.01 s: no such port"):
        read_until(source, lambda _: False)
    source.close()


def test_closing_ends_a_read_in_another_thread(source: SerialSource) -> None:
    events: list[str] = []

    def run() -> None:
        while not events or events[-1] != "end":
            events.append(source.read().event)

    reader = threading.Thread(target=run, daemon=True)
    reader.start()
    source.close()
    reader.join(20.0)
    assert not reader.is_alive()
    assert source.read().event == "end"
    source.close()
    source.write(b"nobody hears this")


def test_closing_while_the_device_is_gone_ends_too(device: Device, source: SerialSource) -> None:
    device.unplug()
    read_until(source, lambda chunk: chunk.event == "disconnected")
    source.close()
    assert source.read().event == "end"


def test_a_port_in_use_says_who_has_it(device: Device, source: SerialSource) -> None:
    with pytest.raises(DeviceError, match=rf"in use by .*\(pid {os.getpid()}\)") as caught:
        SerialSource(str(device.path), comports=list)
    assert "\n" not in str(caught.value)
    assert source.read().event == ""


@pytest.mark.parametrize("reader", ["scandir", "listdir"])
def test_a_program_that_ends_while_the_holder_is_looked_for_is_passed_over(
    reader: str, device: Device, source: SerialSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    with subprocess.Popen(["sleep", "60"]) as child:
        files = f"/proc/{child.pid}/fd"
        read = getattr(os, reader)

        def ending(path: Any = ".") -> Any:
            if os.fspath(path) == files:
                child.kill()
                child.wait()
            return read(path)

        monkeypatch.setattr(os, reader, ending)
        with pytest.raises(DeviceError, match=rf"in use by .*\(pid {os.getpid()}\)"):
            SerialSource(str(device.path), comports=list)
        child.kill()


def test_a_missing_port_says_what_is_there(tmp_path: Path) -> None:
    there = SimpleNamespace(
        device="/dev/ttyS7", vid=None, pid=None, serial_number=None,
        manufacturer=None, product=None, location=None,
    )  # fmt: skip
    with pytest.raises(DeviceError, match=r"no such port .*; found: /dev/ttyS7; see") as caught:
        SerialSource(str(tmp_path / "ttyACM0"), comports=lambda: [there])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("path", ["/dev/null", "/etc/hostname", "/tmp"])
def test_what_is_no_serial_port_is_told_so(path: str) -> None:
    with pytest.raises(DeviceError, match=f"{path} is not a serial port"):
        SerialSource(path, comports=list)


def refusing(error: Exception) -> Callable[[str, int], Transport]:
    def opener(name: str, baud: int) -> Transport:
        raise error

    return opener


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (PermissionError(errno.EACCES, "Permission denied"), "usermod -aG|udev rule"),
        (OSError(errno.EBUSY, "Device or resource busy"), "ModemManager"),
        (OSError("could not open port 'COM9': FileNotFoundError(2, 'x')"), "no such port"),
        (OSError("could not open port 'COM9': PermissionError(13, 'x')"), "in use by"),
        (OSError("something\nelse"), "cannot open .*: something else"),
    ],
)
def test_each_refusal_says_what_to_do(tmp_path: Path, error: Exception, words: str) -> None:
    with pytest.raises(DeviceError, match=words) as caught:
        SerialSource(str(tmp_path / "port"), comports=list, opener=refusing(error))
    assert "\n" not in str(caught.value)


def test_a_device_that_takes_nothing_is_one_clear_line(
    device: Device, source: SerialSource
) -> None:
    with pytest.raises(DeviceError, match="does not take what is written"):
        source.write(bytes(1 << 20))


# --- with a link made of wood: identity, refusals while waiting, the watchdog --------------------


class Link:
    """A link whose reads are scripted; an exception in the script breaks it."""

    def __init__(self, script: list[bytes | Exception]) -> None:
        self.script = script
        self.closed = False

    def read(self, timeout_s: float) -> bytes:
        step = self.script.pop(0) if self.script else b""
        if isinstance(step, Exception):
            raise step
        return step

    def write(self, data: bytes) -> None: ...

    def close(self) -> None:
        self.closed = True


def usb(device: str, serial: str) -> Any:
    return SimpleNamespace(
        device=device, vid=0x0483, pid=0x5740, serial_number=serial,
        manufacturer="ST", product="VCP", location="1-1",
    )  # fmt: skip


class Bench:
    """Ports that come and go, and a clock that goes a second with every look at it."""

    def __init__(self) -> None:
        self.ports = [usb("/dev/ttyACM0", "AA")]
        self.links = [Link([b"x", OSError(5, "gone")])]
        self.refusals: list[Exception] = []
        self.opened: list[str] = []
        self.now = 0

    def open(self, name: str, baud: int) -> Transport:
        if self.refusals:
            raise self.refusals.pop(0)
        if not self.links:
            raise FileNotFoundError(errno.ENOENT, "not there")
        self.opened.append(name)
        return self.links.pop(0)

    def clock(self) -> int:
        self.now += 1_000_000_000
        return self.now

    def source(self, settings: SourceSettings | None = None) -> SerialSource:
        return SerialSource(
            "/dev/ttyACM0",
            settings or SourceSettings(stall_s=1e6),
            comports=lambda: self.ports,
            opener=self.open,
            clock=self.clock,
        )


def events(source: SerialSource, count: int) -> Iterator[str]:
    return (source.read().event for _ in range(count))


def test_the_device_is_found_again_under_another_name() -> None:
    bench = Bench()
    first, second = bench.links[0], Link([b"y"])
    source = bench.source()
    assert source.identity["serial_number"] == "AA"
    bench.links = [second]
    bench.ports = [usb("/dev/ttyACM0", "BB"), usb("/dev/ttyACM1", "AA")]
    assert [one for one in events(source, 10) if one] == ["disconnected", "reconnected"]
    assert bench.opened == ["/dev/ttyACM0", "/dev/ttyACM1"]
    assert source.name == "/dev/ttyACM1"
    assert first.closed


def test_another_board_under_the_old_name_is_left_alone() -> None:
    bench = Bench()
    source = bench.source()
    bench.ports = [usb("/dev/ttyACM0", "BB")]
    bench.links = [Link([b"not ours"])]
    assert [one for one in events(source, 30) if one] == ["disconnected"]
    assert bench.opened == ["/dev/ttyACM0"]


@pytest.mark.parametrize(
    "error",
    [OSError(5, "gone"), TypeError("NoneType"), termios.error(5, "gone")],
)
def test_whatever_a_broken_link_raises_is_a_disconnection(error: Exception) -> None:
    bench = Bench()
    bench.links = [Link([b"x", error])]
    assert "disconnected" in list(events(bench.source(), 3))


def test_refusals_while_waiting_are_tolerated() -> None:
    bench = Bench()
    source = bench.source()
    bench.links = [Link([b"y"])]
    bench.refusals = [PermissionError(errno.EACCES, "no"), OSError(errno.EBUSY, "busy")] * 3
    found = [source.read() for _ in range(60)]
    assert [one.event for one in found if one.event] == ["disconnected", "reconnected"]
    assert source.trouble == ""


def test_waiting_grows_from_a_tenth_of_a_second_to_two() -> None:
    bench = Bench()
    tries: list[int] = []
    source = bench.source()

    def ports() -> list[Any]:
        tries.append(bench.now)
        return []

    source._comports = ports
    bench.clock = source._clock = lambda: bench.now  # type: ignore[method-assign]
    source._sleep = lambda seconds: setattr(bench, "now", bench.now + int(seconds * 1e9))
    list(events(source, 400))
    waits = [round((b - a) * 1e-9, 2) for a, b in itertools.pairwise(tries) if b > a]
    assert waits[:5] == pytest.approx([0.2, 0.4, 0.8, 1.6, 2.0], abs=0.06)
    assert max(waits) <= 2.06


class Stream(Link):
    """A device that sends evenly, on a clock that only sleeping moves."""

    def __init__(self, pace: float) -> None:
        super().__init__([])
        self.pace, self.now, self.read_to = pace, 0, 0

    def sleep(self, seconds: float) -> None:
        self.now += int(seconds * 1e9)

    def read(self, timeout_s: float) -> bytes:
        ready = self.read_to
        while ready == self.read_to:
            self.sleep(1e-4)
            ready = int(self.pace * 1e-9 * self.now)
        data, self.read_to = bytes(ready - self.read_to), ready
        return data


@pytest.mark.parametrize(
    ("pace", "reads_in_s"), [(1.5e3, 99), (40e3, 99), (93e3, 50), (400e3, 190), (4e6, 1650)]
)
def test_bytes_gather_but_never_fill_the_buffer_of_a_tty(pace: float, reads_in_s: int) -> None:
    stream = Stream(pace)
    source = SerialSource(
        "/dev/ttyACM0", comports=list, opener=lambda name, baud: stream,
        clock=lambda: stream.now, sleep=stream.sleep,
    )  # fmt: skip
    sizes = []
    while stream.now < 1_000_000_000:
        sizes.append(len(source.read().data))
    assert len(sizes) == pytest.approx(reads_in_s, rel=0.05)
    assert max(sizes) < 2600


def test_a_reader_that_was_held_up_catches_up_without_a_pause() -> None:
    """The tty is full by then, and what a board cannot hand over fills its own memory."""
    slept: list[float] = []
    source = SerialSource(
        "/dev/ttyACM0", comports=list, sleep=slept.append,
        opener=lambda name, baud: Link([bytes(1700), bytes(4095), bytes(3500), bytes(1700), b"x"]),
    )  # fmt: skip
    for _ in range(5):
        source.read()
    assert len(slept) == 2, "after each of the reads that found no more than usual"


def test_a_hung_device_stalls_once_and_resumes_once() -> None:
    bench = Bench()
    bench.links = [Link([b"x", b"", b"", b"", b"", b"", b"", b"y", b""])]
    source = bench.source(SourceSettings(stall_s=3.5))
    chunks = [source.read() for _ in range(9)]
    assert [chunk.event for chunk in chunks if chunk.event] == ["stalled", "resumed"]
    assert next(chunk.data for chunk in chunks if chunk.event == "resumed") == b"y"


def test_a_device_that_has_never_spoken_does_not_stall() -> None:
    bench = Bench()
    bench.links = [Link([])]
    assert set(events(bench.source(SourceSettings(stall_s=0.5)), 20)) == {""}


def test_a_device_that_comes_back_mute_stalls() -> None:
    bench = Bench()
    source = bench.source(SourceSettings(stall_s=3.5))
    bench.links = [Link([])]
    found = [source.read() for _ in range(40)]
    assert [one.event for one in found if one.event] == ["disconnected", "reconnected", "stalled"]
    gone, back, mute = (one.host_ns for one in found if one.event)
    assert gone < back
    assert mute - back > 3.5e9


# --- sockets and other URLs -----------------------------------------------------------------------


def test_a_socket_is_a_port_too_and_comes_back() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
        source = open_source(url)
        assert isinstance(source, SerialSource)
        peer, _ = server.accept()
        peer.sendall(b"hello" * 1000)
        assert read_bytes(source, 5000) == b"hello" * 1000
        source.write(b"start")
        assert peer.recv(5) == b"start"
        peer.close()
        read_until(source, lambda chunk: chunk.event == "disconnected")
        read_until(source, lambda chunk: chunk.event == "reconnected")
        peer, _ = server.accept()
        peer.sendall(b"x")
        assert read_bytes(source, 1) == b"x"
        source.close()
        peer.close()
    assert source.name == url


def test_a_socket_that_takes_nothing_times_out() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        source = open_source(f"socket://127.0.0.1:{server.getsockname()[1]}")
        peer, _ = server.accept()
        with peer, pytest.raises(DeviceError, match="does not take"):
            source.write(bytes(1 << 26))
        source.close()


def test_other_urls_of_pyserial_work() -> None:
    source = open_source("loop://")
    source.write(b"echo")
    assert isinstance(source, SerialSource)
    assert read_bytes(source, 4) == b"echo"
    source.close()


def test_an_address_nobody_listens_to_is_one_clear_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
    with pytest.raises(DeviceError, match="is the other side running"):
        open_source(url)


@pytest.mark.parametrize("url", ["socket://nowhere", "nonsense://x"])
def test_a_url_that_is_none_is_a_usage_error(url: str) -> None:
    with pytest.raises(UsageError, match="cannot open"):
        open_source(url)


def test_settings_are_checked() -> None:
    with pytest.raises(UsageError, match="baud must be positive"):
        SourceSettings(baud=0)


def test_what_waits_in_the_port_when_it_is_opened_is_read(device: Device) -> None:
    device.say(b"gx[mdps],gy[mdps],gz[mdps]\n")
    source = SerialSource(str(device.path), comports=list)
    device.say(b"1,2,3\n")
    assert read_bytes(source, 33) == b"gx[mdps],gy[mdps],gz[mdps]\n1,2,3\n"
    source.close()


@pytest.mark.parametrize("full", [True, False])
def test_a_port_that_was_full_when_it_was_opened_may_have_lost_what_came_after(
    device: Device, full: bool
) -> None:
    held = device.fill() if full else 9000
    if not full:
        for _ in range(9):
            device.say(bytes(1000))
    source = SerialSource(str(device.path), comports=list)
    assert read_bytes(source, held) == bytes(held)
    device.say(b"later")
    (later,) = read_until(source, lambda chunk: bool(chunk.data))
    source.close()
    assert (later.data, later.event) == (b"later", "overrun" if full else "")


def test_a_stream_that_comes_in_large_reads_from_the_start_has_no_gap(device: Device) -> None:
    """A busy computer reads late and much at once; nothing waited when the port was opened."""
    source = SerialSource(str(device.path), comports=list)
    events = set()
    for _ in range(6):
        device.say(bytes(4000))
        read = read_until(source, lambda chunk: bool(chunk.data))
        events |= {chunk.event for chunk in read}
    source.close()
    assert events == {""}
