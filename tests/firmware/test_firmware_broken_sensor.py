"""A sensor whose bus is stuck or whose supply breaks down: said, mended, and no sample invented."""

import ctypes as c
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from allanscope.samples import Block, Gap, Notice, StreamInfo
from allanscope.wire import WireSettings, format_named
from support.encoder_ring import Ring
from support.lsm6dsm_driver import RESET, SILENT, WELL, Batch, Config, Driver, numbers
from support.lsm6dsm_model import Lsm6dsm

CRYSTAL = 1
STEP_S = 0.005
SANITIZERS = "-g -fsanitize=address,undefined -fno-sanitize-recover=all"
STOP, START = 0x82, 0x81


class Device:
    """The C device with the driver of the real part, on a bus of Python functions, and a host.

    Parameters
    ----------
    library : CDLL
        The C.
    part : Lsm6dsm
        On its bus.
    rate : float
        Of the sensor, in Hz.
    """

    def __init__(self, library, part, rate=416.0):
        self.part = part
        self.events = []
        self.now_s = 0.0
        self._library = library
        self._driver = Driver(library, part)
        self._ring, self._room = Ring(), (c.c_uint8 * 65536)()
        self._device = (c.c_uint64 * 512)()
        self._decoder = format_named("native").decoder(WireSettings())
        library.as_ring_init(c.byref(self._ring), self._room, 65536, 1024)
        config = Config(rate, 250.0, 2.0)
        library.device_init.argtypes = [
            *[c.c_void_p] * 4,
            *(c.c_uint8, c.c_uint16, c.c_uint64),
        ]
        library.device_poll.argtypes = [c.c_void_p, c.c_uint64]
        library.device_watermark.argtypes = [c.c_void_p, c.c_uint64]
        library.device_poll.restype = c.c_bool
        library.device_init(
            self._device,
            *(c.addressof(self._driver.imu), c.addressof(self._ring), c.addressof(config)),
            *(CRYSTAL, 7, 0),
        )
        part.now_s = 0.0

    def run(self, seconds, advance=True):
        """Let time pass for the part and the device, and read what the device sends."""
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            if advance:
                self.part.advance(STEP_S)
            if self.part.edges:
                self._library.device_watermark(self._device, round(self.part.edges.pop() * 1e6))
            while self._library.device_poll(self._device, round(self.now_s * 1e6)):
                pass
            out = bytearray()
            while (byte := self._library.as_ring_take(c.byref(self._ring))) >= 0:
                out.append(byte)
            self.events += self._decoder.feed(bytes(out), self.now_s)

    def samples(self):
        """Return the counts of all samples."""
        blocks = [event.counts for event in self.events if isinstance(event, Block)]
        return np.concatenate([np.empty((0, 6), np.int16), *blocks])

    def said(self):
        """Return what the device said in words."""
        return [
            e.text for e in self.events if isinstance(e, Notice) and e.kind in ("text", "error")
        ]

    def gaps(self):
        """Return the holes."""
        return [event for event in self.events if isinstance(event, Gap)]

    def infos(self):
        """Return the descriptors that told something new."""
        return [event for event in self.events if isinstance(event, StreamInfo)]


def kept(counts):
    """Return which samples of the model these are; fails for any that the part did not make."""
    k = (counts[:, 0].astype(np.int64) + 32768) * pow(7, -1, 65536) % 65536
    expected = np.array([Lsm6dsm.counts(int(one)) for one in k])
    np.testing.assert_array_equal(counts, expected.reshape(-1, 6))
    return k


@pytest.mark.parametrize("level", [0x00, 0xFF])
@pytest.mark.parametrize("before_s", [0.0, 0.1])
def test_a_stuck_bus_gives_no_sample_and_no_loss(library, level, before_s):
    part = Lsm6dsm()
    driver = Driver(library, part)
    assert driver.configure(rate=416.0)
    part.advance(before_s)
    part.stuck = level
    for _ in range(3):
        batch = Batch()
        assert driver.imu.read(c.addressof(driver.imu), 16, c.byref(batch)) == SILENT
        assert (batch.n, batch.lost_before) == (0, 0)
    part.stuck = None
    part.advance(0.1)
    answered, batch = driver.read()
    assert answered
    numbers(batch)


@pytest.mark.parametrize("level", [0x00, 0xFF])
def test_a_bus_that_is_stuck_in_the_middle_of_a_drain_gives_nothing_of_it(library, level):
    part = Lsm6dsm()
    driver = Driver(library, part)
    assert driver.configure(rate=416.0)
    part.advance(0.2)
    assert driver.read()[1].n == 16

    def read(register, n):
        data = Lsm6dsm.read(part, register, n)
        if register == 0x3E:
            part.stuck = level
            return data[:90] + bytes([level]) * (n - 90)
        return data

    part.read = read
    answered, batch = driver.read()
    assert (answered, batch.n, batch.lost_before) == (False, 0, 0)
    part.stuck = None
    del part.read
    answered, batch = driver.read()
    assert answered
    assert batch.lost_before > 0, "what was thrown away is missing, and told"


def test_a_part_whose_supply_broke_down_is_known_from_a_silent_one(library):
    part = Lsm6dsm()
    driver = Driver(library, part)
    assert driver.configure()
    part.advance(1.0)
    part.brown_out()
    batch = Batch()
    assert driver.imu.read(c.addressof(driver.imu), 16, c.byref(batch)) == RESET
    assert batch.n == 0
    assert driver.configure()
    part.advance(1.0)
    assert driver.imu.read(c.addressof(driver.imu), 16, c.byref(batch)) == WELL
    assert batch.n == 16


@pytest.mark.parametrize("level", [0x00, 0xFF])
def test_a_driver_that_never_reached_its_part_takes_a_dead_bus_for_none(library, level):
    part = Lsm6dsm()
    part.stuck = level
    driver = Driver(library, part)
    assert not driver.configure(rate=150.0)
    answered, batch = driver.read()
    assert (answered, batch.n) == (False, 0)


@pytest.mark.parametrize("level", [0x00, 0xFF])
def test_a_device_says_that_its_bus_is_stuck_and_goes_on_to_the_sample(library, level):
    part = Lsm6dsm(0.02)
    device = Device(library, part)
    device.run(2.0)
    part.stuck = level
    device.run(3.0)
    assert device.said() == ["the sensor does not answer"]
    here = len(device.samples())
    part.stuck = None
    device.run(2.0)
    assert device.said() == ["the sensor does not answer", "the sensor answers again"]
    (gap,) = device.gaps()
    assert gap.reason == "sensor"
    k = kept(device.samples())
    assert set(np.diff(k)) == {1, gap.lost + 1}
    assert len(device.samples()) > here + 700
    assert len(device.infos()) == 1, "the descriptor is that of the epoch, whatever the bus gives"


def test_after_a_stall_each_frame_has_the_time_of_its_own_samples(library):
    """A quarter of a second of samples comes at once: they are as old as they lie deep."""
    part = Lsm6dsm()
    device = Device(library, part)
    device.run(1.0)
    part.advance(0.25)
    device.now_s += 0.25
    device.run(1.0)
    blocks = [event for event in device.events if isinstance(event, Block)]
    at = np.concatenate([block.ticks.offset + block.index for block in blocks])
    times = np.concatenate([block.ticks.device_s for block in blocks])
    k = kept(device.samples())
    late = times - (k[at - at[0]] + 1) / 416.0
    assert (np.diff(times) > 0.0).all()
    assert np.ptp(late) < 2 * STEP_S


@pytest.mark.parametrize("interrupt", [0, 2])
@pytest.mark.parametrize("off", [-0.05, 0.0, 0.05])
def test_with_the_interrupt_a_frame_has_the_time_at_which_its_samples_were_taken(
    library, off, interrupt
):
    """Without it each is late by when the main loop happened to look, here up to 5 ms."""
    part = Lsm6dsm(off, interrupt=interrupt)
    device = Device(library, part)
    device.run(4.0)
    blocks = [event for event in device.events if isinstance(event, Block)][4:]
    at = np.concatenate([block.ticks.offset + block.index for block in blocks])
    times = np.concatenate([block.ticks.device_s for block in blocks])
    late = times - (at + 18) / (416.0 * (1.0 + off))
    if interrupt:
        # What is left is what the nominal period is off over one frame.
        left = 9 * abs(off) / (416.0 * (1.0 + off)) + 5e-6
        assert np.ptp(late) < left
        assert abs(np.median(late)) < left
        assert min(map(len, blocks)) == 9, "whole frames, what is over waits for the next"
    else:
        assert np.ptp(late) > 1e-3


@pytest.mark.parametrize("off", [-0.05, 0.0, 0.05])
def test_an_interrupt_that_dies_is_said_once_and_when_it_comes_again(library, off):
    """Its wire breaks: samples come by time, in frames as often as before, and none is missing."""
    part = Lsm6dsm(off, interrupt=2)
    device = Device(library, part)
    device.run(2.0)
    assert device.said() == []
    part.interrupt = 0
    device.run(0.5)
    assert [text.partition(":")[0] for text in device.said()] == [
        "the interrupt of the sensor does not come"
    ]
    before = len(device.events)
    device.run(1.0)
    blocks = [event for event in device.events[before:] if isinstance(event, Block)]
    times = {host_s for block in blocks for host_s in block.ticks.host_s.tolist()}
    assert len(times) >= 0.9 * 416 / 9, "each frame when it is complete, not two at a time"
    part.interrupt = 2
    device.run(4.0)
    assert device.said()[1:] == ["the interrupt of the sensor comes again"]
    assert device.gaps() == []
    assert (np.diff(kept(device.samples())) == 1).all()


def test_a_time_stamp_that_stands_still_is_said_once_and_when_it_is_over(library):
    part = Lsm6dsm()
    device = Device(library, part)
    device.run(1.0)
    part.ticking = False
    device.run(1.0)
    assert [text.partition(":")[0] for text in device.said()] == [
        "the time stamp of the sensor stands still"
    ]
    part.ticking = True
    device.run(1.0)
    assert device.said()[1:] == ["the time stamp of the sensor runs again"]
    assert device.gaps() == []


@pytest.mark.parametrize("status", [0x13, 0x50, 0x00])
def test_a_fifo_that_is_empty_and_is_not_gives_nothing_and_is_said(library, status):
    """Empty with a level or an overrun, or neither empty nor of any level."""
    part = Lsm6dsm()
    part.fifo.clear()
    device = Device(library, part)
    device.run(1.0)
    here = len(device.samples())
    part.status = status
    if status == 0x00:
        part.fifo.clear()
    device.run(0.1, advance=False)
    assert len(device.samples()) == here
    assert [text.partition(":")[0] for text in device.said()] == [
        "the FIFO of the sensor says that it is empty and that it is not"
    ]
    part.status = None
    device.run(1.0)
    assert device.said()[1:] == ["the FIFO of the sensor is consistent again"]
    kept(device.samples())


@pytest.mark.parametrize("one_data_line", [False, True])
@pytest.mark.parametrize("rate", [12.5, 416.0, 6660.0])
def test_a_device_whose_part_breaks_down_says_so_sets_it_up_again_and_goes_on(
    library, one_data_line, rate
):
    part = Lsm6dsm(one_data_line=one_data_line)
    device = Device(library, part, rate)
    device.run(4.0)
    before = len(device.samples())
    assert before > 2 * rate
    part.brown_out()
    device.run(4.0)
    (text,) = device.said()
    assert "was reset and has been set up again" in text
    assert device.gaps() == [Gap("restarted", None)]
    first, second = device.infos()
    assert second.epoch == first.epoch + 1
    assert second.details["registers"] == first.details["registers"]
    k = kept(device.samples())
    assert len(k) > before + 2 * rate
    assert (np.diff(k) < 0).sum() == 1, "the part counts from zero again, once"


def test_a_device_that_boots_with_a_dead_bus_says_so_and_starts_when_it_is_mended(library):
    part = Lsm6dsm()
    part.stuck = 0xFF
    device = Device(library, part)
    device.run(2.0)
    assert device.said() == ["the sensor does not answer"]
    part.stuck = None
    device.run(2.0)
    assert len(kept(device.samples())) > 700


def test_after_a_silence_in_which_the_time_stamp_may_have_wrapped_nothing_is_counted(library):
    part = Lsm6dsm()
    device = Device(library, part, rate=12.5)
    device.run(2.0)
    part.stuck = 0x00
    device.run(1.0)
    device.now_s += 500.0
    part.stuck = None
    device.run(2.0)
    assert device.gaps() == [Gap("restarted", None)]
    kept(device.samples())


@pytest.mark.parametrize(
    ("rooms", "tests", "fewest"),
    [
        (("broken_sensor", "lsm6dsm"), "test", 40),
        (("sensortile",), "cuts_off or through_bus or one_burst or halted or gives_up", 10),
    ],
)
def test_the_sanitized_build_passes_the_same_tests_and_finds_nothing(
    compiler, rooms, tests, fewest
):
    """Once more with ASan and UBSan, in a process that loads ASan before everything else."""
    if os.environ.get("ALLANSCOPE_SANITIZE"):
        return
    asan = subprocess.run(
        [compiler, "-print-file-name=libasan.so"], capture_output=True, text=True, check=True
    ).stdout.strip()
    if not Path(asan).is_absolute():
        pytest.skip("no ASan on this machine; install gcc with its libraries")
    here = Path(__file__).parent
    names = [str(here / f"test_firmware_{name}.py") for name in rooms]
    names += ["-k", tests]
    # What Python itself keeps until its end is no leak of the driver.
    environment = {"LD_PRELOAD": asan, "ASAN_OPTIONS": "detect_leaks=0"}
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *names],
        env={**os.environ, **environment, "ALLANSCOPE_SANITIZE": SANITIZERS},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "Sanitizer" not in ran.stderr + ran.stdout
    assert int(re.findall(r"(\d+) passed", ran.stdout)[-1]) >= fewest
