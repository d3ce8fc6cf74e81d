"""The device on real ports, read with pyserial as any reader would. No test looks at a clock."""

from __future__ import annotations

import os
import sys
import termios
import threading
from pathlib import Path

import numpy as np
import pytest
import serial

from allanscope.errors import UsageError
from allanscope.samples import Block, Gap, Notice
from allanscope.simulator import Device, Simulator, run_device
from allanscope.simulator.virtual_port import TcpPort
from allanscope.wire import WireSettings, format_named

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

FAST = float("inf")


class Reader:
    """The shortest reader that does it right."""

    def __init__(self, url):
        self.url = url
        self.decoder = format_named("native").decoder(WireSettings())
        self.events = []
        self.lost_port = 0
        self.open()

    def open(self):
        for _ in range(500):
            try:
                self.port = serial.serial_for_url(self.url, timeout=0.02)
                return
            except serial.SerialException:
                threading.Event().wait(0.01)
        pytest.fail(f"{self.url} did not come back")

    def read_until(self, enough):
        """Read until `enough()` or until nothing more can be hoped for."""
        for _ in range(20_000):
            if enough():
                return
            try:  # a socket never says that more than one byte waits
                most = 4096 if "://" in self.url else self.port.in_waiting or 1
                data = self.port.read(most)
            except (OSError, TypeError):
                self.lost_port += 1
                self.port.close()
                self.events += self.decoder.interrupt("disconnected")
                self.open()
                continue
            self.events += self.decoder.feed(data, 0.0)
        pytest.fail("the device did not do what was waited for")

    def read_samples(self, n):
        self.read_until(lambda: self.samples >= n)

    @property
    def samples(self):
        return self.decoder.stats.samples

    @property
    def blocks(self):
        return [event for event in self.events if isinstance(event, Block)]

    def missing(self):
        seen = np.concatenate([b.index + np.arange(len(b)) for b in self.blocks])
        return int(seen[-1] + 1 - seen[0] - len(seen)), int(seen[0]), int(seen[-1] + 1)


@pytest.mark.parametrize("port", ["pty", "tcp"])
def test_samples_arrive_as_the_sensor_made_them(port):
    with Device(
        Simulator(rate=6660.0, seed=2), speed=FAST, port=TcpPort() if port == "tcp" else None
    ) as device:
        reader = Reader(device.url)
        reader.read_samples(50_000)
        reader.port.close()
    counts = np.concatenate([block.counts for block in reader.blocks])
    assert np.array_equal(counts, Simulator(rate=6660.0, seed=2).read(len(counts)).counts)
    assert reader.decoder.stats.lost_samples == 0
    assert reader.decoder.stats.crc_errors == 0


def test_losses_on_a_real_port_are_those_of_the_ledger():
    faults = ["bit_flip:rate=1e-4", "byte_loss:rate=1e-4", "garbage:rate=1e-4"]
    with Device(Simulator(rate=1660.0), faults=faults, speed=FAST) as device:
        reader = Reader(device.url)
        reader.read_samples(30_000)
        reader.port.close()
        epoch = device.epoch
    missing, first, stop = reader.missing()
    assert missing == device.ledger.missing(epoch, first, stop) > 1000


def test_a_host_that_does_not_read_makes_the_device_drop_and_count():
    with Device(Simulator(rate=1660.0), speed=200.0, ring_bytes=4096) as device:
        reader = Reader(device.url)
        reader.read_samples(100)
        while device.ledger.lost["ring full"] < 5000:
            threading.Event().wait(0.01)
        behind = device.ledger.produced
        reader.read_until(lambda: reader.blocks[-1].index > behind)
        reader.port.close()
        epoch = device.epoch
    missing, first, stop = reader.missing()
    assert missing == device.ledger.missing(epoch, first, stop) >= 5000
    gaps = [event for event in reader.events if isinstance(event, Gap)]
    assert {gap.reason for gap in gaps} == {"device"}
    assert sum(gap.lost for gap in gaps) == missing


def test_a_pulled_cable_fails_the_port_and_comes_back_under_the_same_name():
    faults = ["unplug:at=20,seconds=30"]
    with Device(Simulator(rate=104.0), faults=faults, speed=FAST) as device:
        reader = Reader(device.url)
        reader.read_until(lambda: reader.lost_port and reader.samples > 6000)
        reader.port.close()
        epoch = device.epoch
    assert reader.lost_port == 1
    missing, first, stop = reader.missing()
    assert missing == device.ledger.missing(epoch, first, stop)
    assert missing == pytest.approx(30 * 104, rel=0.06)


def test_cable_pulled_under_a_host_that_does_not_read():
    """What was in the port is thrown away by the system; the ledger knows how much it was."""
    with Device(Simulator(rate=1660.0), faults=["unplug:at=20,seconds=5"], speed=200.0) as device:
        reader = Reader(device.url)
        reader.read_samples(100)
        while not device.ledger.faults["unplug"]:
            threading.Event().wait(0.01)
        reader.read_until(lambda: reader.lost_port and len(reader.blocks[-1]))
        behind = reader.samples
        reader.read_samples(behind + 1000)
        reader.port.close()
        epoch = device.epoch
    missing, first, stop = reader.missing()
    assert missing == device.ledger.missing(epoch, first, stop)
    assert device.ledger.lost["hang-up"] > 0


def test_a_host_that_closes_and_comes_back_finds_the_index_further_on():
    with Device(Simulator(rate=1660.0), speed=100.0) as device:
        reader = Reader(device.url)
        reader.read_samples(1000)
        reader.port.close()
        reader.events += reader.decoder.interrupt("disconnected")
        while device.ledger.lost["no host"] < 2000:
            threading.Event().wait(0.01)
        reader.open()
        reader.read_samples(5000)
        reader.port.close()
        epoch = device.epoch
    missing, first, stop = reader.missing()
    assert missing == device.ledger.missing(epoch, first, stop) >= 2000


def test_a_device_waits_for_its_first_host():
    with Device(Simulator(rate=6660.0), speed=1000.0) as device:
        threading.Event().wait(0.2)
        assert device.ledger.produced == 0
        reader = Reader(device.url)
        reader.read_samples(100)
        reader.port.close()
    assert reader.blocks[0].index == 0


def test_commands_are_obeyed_over_the_port():
    wire = format_named("native")
    with Device(Simulator(rate=104.0), speed=50.0) as device:
        reader = Reader(device.url)
        for message in wire.start(WireSettings(rate_hz=833.0)):
            reader.port.write(message)
        texts = lambda: [e.text for e in reader.events if isinstance(e, Notice)]  # noqa: E731
        reader.read_until(lambda: {"set: ok", "describe: ok", "start: ok"} <= set(texts()))
        reader.read_samples(2000)
        for message in wire.stop():
            reader.port.write(message)
        reader.read_until(lambda: "stop: ok" in texts())
        produced = device.ledger.produced
        threading.Event().wait(0.1)
        assert device.ledger.produced == produced
        reader.port.close()


def test_the_port_does_not_echo():
    """A cooked pty would send the host's own words back, and the device would hear its own."""
    with Device(Simulator(rate=104.0), speed=FAST) as device:
        reader = Reader(device.url)
        reader.port.write(b"hello\r\n\x03\x04")
        reader.read_samples(5000)
        reader.port.close()
    assert reader.decoder.stats.crc_errors == 0
    assert reader.decoder.stats.resyncs == 0
    assert device.ledger.commands == 0


def test_the_port_is_raw_before_any_host_makes_it_so():
    device = Device(Simulator())
    host = os.open(device.url, os.O_RDWR | os.O_NOCTTY)
    mode = termios.tcgetattr(host)
    os.close(host)
    device.stop()
    assert not mode[0] & (termios.ICRNL | termios.IXON)
    assert not mode[1] & termios.OPOST
    assert not mode[3] & (termios.ECHO | termios.ICANON | termios.ISIG)


class FakePort:
    """A port that is always attached, counts how often it was waited for, and takes all."""

    url = "fake"

    def __init__(self, *words):
        self.words = list(words)
        self.waits = 0
        self.waits_before_first_write = None

    def attached(self):
        return True

    def read(self):
        return self.words.pop() if self.words else b""

    def write(self, data):
        if self.waits_before_first_write is None:
            self.waits_before_first_write = self.waits
        return len(data)

    def wait(self, timeout_s):
        self.waits += 1
        threading.Event().wait(timeout_s)

    def close(self):
        pass


def first_write(port):
    with Device(Simulator(), port=port, speed=FAST) as device:
        for _ in range(2000):
            if port.waits_before_first_write is not None:
                break
            threading.Event().wait(0.01)
        assert device.url == "fake"
    return port.waits_before_first_write


def test_nothing_is_sent_while_pyserial_may_still_be_clearing_the_port():
    """It clears what has come after it has opened a port; so the device waits a moment."""
    assert first_write(FakePort()) >= 2


def test_a_host_that_speaks_is_answered_at_once():
    assert first_write(FakePort(b"hello")) == 0


class BusyComputer(FakePort):
    """A pty whose host takes all at every look, and a computer that once stands still for 3 s."""

    def __init__(self):
        super().__init__(b"start")
        self.now, self.waiting, self.device = 0.0, 0, None

    def monotonic(self):
        return self.now

    def write(self, data):
        taken = min(len(data), 4096 - self.waiting)
        self.waiting += taken
        return taken

    def wait(self, timeout_s):
        self.waits += 1
        self.waiting = 0
        self.now += 3.0 if self.waits == 100 else timeout_s
        if self.now > 10.0:
            self.device._stopping.set()


def test_a_computer_that_stands_still_costs_the_board_no_sample(monkeypatch):
    """A real board would have gone on meanwhile; it must not overflow because it runs here."""
    port = BusyComputer()
    monkeypatch.setattr("allanscope.simulator.device.time", port)
    port.device = Device(Simulator(rate=6660.0), port=port)
    port.device.start().wait()
    ledger = port.device.ledger
    assert not ledger.lost
    assert ledger.produced > 9.5 * 6400


def test_nothing_is_left_behind():
    threads, files = threading.active_count(), len(os.listdir("/proc/self/fd"))
    device = Device(Simulator(), speed=10.0, faults=["unplug:at=2,seconds=1"]).start()
    reader = Reader(device.url)
    reader.read_until(lambda: reader.lost_port and reader.samples > 300)
    reader.port.close()
    device.stop()
    assert not os.path.lexists(device.url)
    assert not Path(device.url).parent.exists()
    assert threading.active_count() == threads
    assert len(os.listdir("/proc/self/fd")) == files


def test_a_device_that_was_never_started_leaves_nothing_either():
    device = Device(Simulator())
    assert os.path.lexists(device.url)
    device.stop()
    assert not os.path.lexists(device.url)


def test_a_path_can_be_chosen_and_a_dead_link_there_is_replaced(tmp_path):
    path = tmp_path / "ttyBench"
    path.symlink_to("/dev/pts/99999")
    with Device(Simulator(), path=path, speed=FAST) as device:
        assert device.url == str(path)
        reader = Reader(path.as_posix())
        reader.read_samples(100)
        reader.port.close()
    assert not os.path.lexists(path)


def test_a_path_that_is_taken_is_left_alone(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("mine")
    with pytest.raises(UsageError, match="exists and is not a link"):
        Device(Simulator(), path=path)
    assert path.read_text() == "mine"
    with pytest.raises(UsageError, match="cannot make a port"):
        Device(Simulator(), path=tmp_path / "no folder" / "tty")


def test_what_fails_in_the_thread_is_raised_by_stop():
    sensor = Simulator()
    sensor.read = lambda n: 1 / 0
    device = Device(sensor, speed=FAST).start()
    port = serial.Serial(device.url)
    assert device.wait(20.0)
    port.close()
    with pytest.raises(ZeroDivisionError):
        device.stop()
    assert not os.path.lexists(device.url)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_impossible_speeds_are_refused(speed):
    with pytest.raises(UsageError, match="times real time"):
        Device(speed=speed)


def test_run_device_announces_its_port_and_ends():
    announced = []
    ledger = run_device(Device(Simulator()), duration_s=0.05, announce=announced.append)
    assert len(announced) == 1
    assert not os.path.lexists(announced[0])
    assert ledger.produced == 0  # nobody came
