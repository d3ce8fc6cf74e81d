"""The SensorTile's firmware on a register-level model of its chip, its sensor and its cable."""

import ctypes
import itertools
import os
import re
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path

import numpy as np
import pytest

from allanscope.samples import Block, Gap, Notice, StreamInfo
from allanscope.wire import WireSettings, format_named
from allanscope.wire.native.framing import pack_frame
from support.emulator import Patience
from support.lsm6dsm_model import Lsm6dsm
from support.stm32l476_model import STALL, Chip
from support.usb_host import Refused, UsbHost

DEVICE = Path(__file__).parents[2] / "firmware_protocol" / "device"
START, STOP, DESCRIBE, SET, PING = 0x81, 0x82, 0x83, 0x84, 0x85
FAST = """
#include "sensor_spi.h"
bool (*bus_read)(uint8_t reg, uint8_t *to, uint16_t n);
bool (*bus_write)(uint8_t reg, uint8_t value);
void sensor_spi_init(void) {}
bool sensor_spi_read(void *context, uint8_t reg, uint8_t *to, uint16_t n)
{ (void)context; return bus_read(reg, to, n); }
bool sensor_spi_write(void *context, uint8_t reg, uint8_t value)
{ (void)context; return bus_write(reg, value); }
"""


@pytest.fixture(scope="module")
def build(compiler, tmp_path_factory):
    """Return what builds the firmware for the host: a new copy each time, its memory cleared."""
    out = tmp_path_factory.mktemp("sensortile")
    (out / "bus.c").write_text(FAST)
    strict = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow"]
    strict += ["-Werror", "-DMMIO_MODEL", f"-I{DEVICE}", f"-I{DEVICE.parent / 'encoder'}"]
    strict += [f"-I{DEVICE / 'sensortile'}", "-fPIC", "-shared"]
    strict += os.environ.get("ALLANSCOPE_SANITIZE", "").split()
    names = ("device", "descriptor", "imu", "lsm6dsm", "lsm6dsm_self_test")
    shared = [DEVICE / f"{name}.c" for name in names]
    shared += DEVICE.parent.glob("encoder/*.c")
    own = set(DEVICE.glob("sensortile/*.c"))
    spi = DEVICE / "sensortile" / "sensor_spi.c"
    kinds = {"spi": own, "bus": own - {spi} | {out / "bus.c"}}
    counter = itertools.count()

    def load(name, rate):
        image = out / f"{name}{rate}.so"
        if not image.exists():
            flags = [*strict, f"-DSTART_RATE_HZ={rate}.0f", "-o", str(image)]
            subprocess.run([compiler, *flags, *map(str, [*shared, *kinds[name]])], check=True)
        copy = out / f"copy{next(counter)}.so"
        copy.write_bytes(image.read_bytes())
        return ctypes.CDLL(str(copy))

    return load


class Bench:
    """A board on a cable, and a host that decodes."""

    def __init__(self, build, name="bus", rate=104, part=None, **chip):
        part = part or Lsm6dsm(0.01, one_data_line=True, interrupt=2)
        self.library = build(name, rate)
        self.chip = Chip(self.library, part, **chip)
        if name == "bus":
            self._wire(part)
        self.part = part
        self.chip.begin()
        self.host = UsbHost(self.chip)
        self.events = []
        self.seq = 0
        self._decoder = format_named("native").decoder(WireSettings())

    def _wire(self, part):
        byte, pointer = ctypes.c_uint8, ctypes.POINTER(ctypes.c_uint8)

        def read(reg, to, n):
            ctypes.memmove(to, part.read(reg, n), n)
            return True

        self._functions = (
            ctypes.CFUNCTYPE(ctypes.c_bool, byte, pointer, ctypes.c_uint16)(read),
            ctypes.CFUNCTYPE(ctypes.c_bool, byte, byte)(part.write),
        )
        for name, function in zip(("bus_read", "bus_write"), self._functions, strict=True):
            at = ctypes.c_void_p.in_dll(self.library, name)
            at.value = ctypes.cast(function, ctypes.c_void_p).value

    def plug(self):
        self.host.enumerate()
        self.host.open()
        return self

    def feed(self, data):
        self.events += self._decoder.feed(data, self.chip.now_us * 1e-6)

    def run(self, seconds, reading=True):
        self.feed(self.host.run(seconds, reading))

    def ask(self, kind, body=b""):
        """Send a command and return the result of the reply, and how long it took."""
        self.seq += 1
        begun = self.chip.now_us
        self.host.write(b"\0" + pack_frame(kind, self.seq, 0, body))
        for _ in range(2000):
            self.chip.turn()
            self.feed(self.host.read())
            replies = [e for e in self.events if isinstance(e, Notice) and e.kind == "reply"]
            for reply in replies:
                if reply.fields["sequence"] == self.seq:
                    return reply.fields["result"], self.chip.now_us - begun
        raise TimeoutError("no reply")

    def of(self, kind):
        return [event for event in self.events if isinstance(event, kind)]

    def samples(self):
        """Return which samples of the part came; fails for any that it did not make."""
        counts = np.concatenate([np.empty((0, 6), np.int16), *(b.counts for b in self.of(Block))])
        k = (counts[:, 0].astype(np.int64) + 32768) * pow(7, -1, 65536) % 65536
        expected = [Lsm6dsm.counts(int(one)) for one in k]
        np.testing.assert_array_equal(counts, np.array(expected).reshape(-1, 6))
        return k

    def status(self):
        found = [e for e in self.of(Notice) if e.kind == "status"]
        return found[-1].fields if found else {}

    def said(self):
        return [e.text for e in self.of(Notice) if e.kind in ("text", "error")]


# --- the serial port --------------------------------------------------------------------------


def test_a_host_finds_a_serial_port_of_the_communications_class(build):
    bench = Bench(build)
    control, data = bench.host.enumerate()
    assert struct.unpack_from("<HH", bench.host.device, 8) == (0x0483, 0x5740)
    assert bench.host.device[4] == 2
    assert (control.codes, data.codes) == ((2, 2, 0), (10, 0, 0))
    assert control.functional[0x06] == bytes([0, 1]), "union of control and data"
    assert control.functional[0x02] == b"\x02", "line coding and control lines"
    assert list(control.endpoints.values()) == [(3, 8)]
    assert data.endpoints == {0x01: (2, 64), 0x81: (2, 64)}
    assert bench.host.descriptor(3) == bytes([4, 3, 9, 4])
    assert "allanscope" in bench.host.text(1)
    assert "SensorTile" in bench.host.text(2)
    assert bench.host.text(3) == "002100453336510120373357"


def test_what_is_not_offered_is_refused_and_the_next_request_is_answered(build):
    host = Bench(build).plug().host
    for kind, request, value in (
        (0x80, 6, 0x0600),  # qualifier of high speed
        (0x80, 6, 0x0304),
        (0x00, 9, 2),
        (0x01, 11, 1),
        (0x40, 1, 0),
        (0x21, 0x7F, 0),
        (0x82, 0, 0x1234),
    ):
        with pytest.raises(Refused):
            host.control(kind, request, value, 5 if kind & 3 == 2 else 0, 2 if kind & 0x80 else 0)
        assert host.control(0x80, 8, length=1) == b"\x01"
    assert host.control(0x80, 0, length=2) == b"\0\0"


def test_line_coding_is_kept_and_changes_nothing(build):
    bench = Bench(build).plug()
    coding = struct.pack("<IBBB", 921600, 0, 0, 8)
    bench.host.control(0x21, 0x20, data=coding)
    assert bench.host.control(0xA1, 0x21, length=7) == coding
    bench.host.control(0x21, 0x23, 100)
    bench.run(0.2)
    assert len(bench.samples())


def test_an_endpoint_can_be_halted_and_goes_on_when_it_is_not(build):
    bench = Bench(build).plug()
    bench.run(0.3)
    bench.host.control(0x02, 3, 0, 0x81)
    assert bench.host.control(0x82, 0, 0, 0x81, 2) == b"\x01\0"
    assert bench.host.usb.host_in(1) is STALL
    bench.host.control(0x02, 1, 0, 0x81)
    assert bench.host.control(0x82, 0, 0, 0x81, 2) == b"\0\0"
    seen = len(bench.samples())
    bench.run(0.3)
    assert len(bench.samples()) > seen + 20


def test_a_request_that_the_host_gives_up_does_not_disturb_the_next(build):
    bench = Bench(build).plug()
    usb = bench.host.usb
    for packet in (
        struct.pack("<BBHHH", 0x80, 6, 0x0200, 0, 67),  # never fetched
        struct.pack("<BBHHH", 0x21, 0x20, 0, 0, 7),  # never sent
    ):
        usb.host_setup(packet)
        for _ in range(3):
            bench.chip.turn()
        assert bench.host.descriptor(1) == bench.host.device
    usb.host_setup(struct.pack("<BBHHH", 0x80, 6, 0x0100, 0, 18))
    usb.host_setup(struct.pack("<BBHHH", 0x80, 8, 0, 0, 1))  # two in a row: the last counts
    assert bench.host._until(lambda: usb.host_in(0)) == b"\x01"


# --- samples ----------------------------------------------------------------------------------


def test_every_sample_comes_once_through_bus_and_cable(build):
    bench = Bench(build, "spi").plug()
    bench.run(1.5)
    k = bench.samples()
    assert len(k) > 120
    assert (np.diff(k) == 1).all()
    assert bench.of(Gap) == []
    assert bench.said() == []
    info = bench.of(StreamInfo)[0]
    assert (info.part, info.nominal_hz, info.details["clock"]) == ("LSM6DSM", 104.0, "crystal")
    assert "0a:26" in info.details["registers"], "FIFO at 104 Hz, continuous"
    watchdog = bench.chip.watchdog
    assert watchdog.started
    assert watchdog.period_s == pytest.approx(2.0, rel=1e-3)
    assert 0.0 < watchdog.longest_us < 0.1e6


def test_a_frame_is_one_burst_of_dma_and_no_word_too_many_is_clocked(build):
    bench = Bench(build, "spi", rate=833).plug()
    bench.run(0.5)
    bench.chip.spi.bursts.clear()
    bench.run(0.5)
    k = bench.samples()
    assert (np.diff(k) == 1).all()
    long = [size for size in bench.chip.spi.bursts if size > 4]
    assert set(long) == {16 * 18}
    assert len(long) == pytest.approx(0.5 * 833 * 1.01 / 16, abs=2)


@pytest.mark.parametrize("late_cycles", [30, 60, 120, 250])
def test_a_clock_that_is_switched_off_too_late_costs_counted_samples(build, late_cycles):
    """Some 50 cycles late, the last byte is over, and the next takes a word out of the FIFO."""
    bench = Bench(build, "spi").plug()
    for _ in range(4):
        bench.run(0.2)
        bench.chip.spi.late_cycles = late_cycles
    bench.run(0.4)
    assert bench.chip.spi.late_cycles == 0
    gaps = bench.of(Gap)
    assert sum(gap.lost for gap in gaps) == (np.diff(bench.samples()) - 1).sum()
    too_late = late_cycles > 50
    assert bool(gaps) == too_late
    assert {gap.reason for gap in gaps} <= {"sensor"}
    silent = ["the sensor does not answer", "the sensor answers again"]
    assert bench.said() == silent * 4 * too_late


def test_device_times_are_those_of_the_edges_to_the_microsecond(build):
    bench = Bench(build).plug()
    bench.run(3.0)
    blocks = bench.of(Block)[3:]
    times = np.concatenate([block.ticks.device_s for block in blocks])
    at = np.concatenate([block.index + block.ticks.offset for block in blocks])
    late = times - at / (104.0 * 1.01)
    assert np.ptp(late) < 3 * 0.01 / 104.0 + 5e-6


def test_at_6660_hz_nothing_is_lost_and_commands_are_answered(build):
    bench = Bench(build, rate=6660).plug()
    bench.run(1.0)
    for body in (b"", b"abc", bytes(32)):
        begun_us = bench.chip.now_us
        result, took_us = bench.ask(PING, body)
        assert result == 0
        assert took_us <= 4000
        taken_us = bench.of(Notice)[-1].fields["uptime_s"] * 1e6
        assert begun_us - 1 <= taken_us <= begun_us + took_us + 1, "the time at which it was taken"
    bench.run(0.5)
    assert len(bench.samples()) > 9000
    assert bench.of(Gap) == []
    assert (np.diff(bench.samples()) % 65536 == 1).all()


def test_a_host_that_stops_reading_loses_what_the_board_says_and_can_still_stop_it(build):
    bench = Bench(build, rate=6660).plug()
    bench.run(0.3)
    bench.run(2.0, reading=False)
    bench.run(1.5)
    gaps = bench.of(Gap)
    assert sum(gap.lost for gap in gaps) == bench.status()["dropped"] > 8000
    assert {gap.reason for gap in gaps} == {"device"}
    bench.samples()
    bench.run(1.0, reading=False)
    assert bench.ask(STOP)[0] == 0, "the answer has room in a queue full of data"


def test_a_slow_host_gets_as_much_as_it_takes(build):
    """20 kB/s of 93: three quarters are dropped in whole frames, none is damaged."""
    bench = Bench(build, rate=6660).plug()
    for _ in range(2000):
        bench.chip.turn()
        if int(bench.chip.now_us / 1000) % 3 == 0:
            bench.feed(bench.host.read(64))
    bench.run(1.5)
    assert sum(gap.lost for gap in bench.of(Gap)) == bench.status()["dropped"] > 0
    assert bench.status()["overruns"] == 0
    bench.samples()


@pytest.mark.parametrize("busy_ms", [7, 9, 14])
def test_a_processor_too_slow_for_its_rate_carries_what_it_can_and_obeys(build, busy_ms):
    """At 3330 Hz a frame is 4.8 ms: a processor of 4 MHz that takes 9 has to lose almost half."""
    bench = Bench(build, rate=3330).plug()
    bench.chip.busy_ms = busy_ms
    bench.run(3.0)
    begun = len(bench.samples())
    made = bench.part.produced
    bench.run(2.0)
    came, made = len(bench.samples()) - begun, bench.part.produced - made
    assert came > 0.95 * made * min(1.0, 16e3 / 3363 / busy_ms), "all that it has time for"
    for _ in range(3):
        result, took_us = bench.ask(PING)
        assert result == 0
        assert took_us <= 3e3 * busy_ms, "not behind the whole FIFO"
    k = bench.samples()
    gaps = bench.of(Gap)
    assert {gap.reason for gap in gaps} == {"sensor"}
    assert sum(gap.lost for gap in gaps) == (np.diff(k) % 65536 - 1).sum() > 0.2 * made
    assert bench.ask(STOP)[0] == 0
    bench.run(0.2)
    seen = len(bench.samples())
    bench.run(0.5)
    assert len(bench.samples()) == seen


def test_a_set_from_the_host_reaches_the_part(build):
    bench = Bench(build).plug()
    bench.run(0.1)
    assert bench.ask(SET, b"\x0a\x04" + struct.pack("<f", 833.0))[0] == 0
    bench.run(1.0)
    assert bench.of(StreamInfo)[-1].nominal_hz == 833.0
    assert bench.part.registers[0x11] >> 4 == 7
    assert bench.ask(STOP)[0] == 0
    bench.run(0.2)
    seen = len(bench.samples())
    bench.run(0.5)
    assert len(bench.samples()) == seen


# --- the cable --------------------------------------------------------------------------------


@pytest.mark.parametrize("moment", range(6))
def test_a_transfer_that_an_unplug_cuts_off_never_wedges_the_port(build, moment):
    """Pulled at any packet of a transfer, and put back into another host."""
    bench = Bench(build, rate=6660).plug()
    bench.run(0.2)
    for _ in range(3):
        for _ in range(10):
            bench.chip.turn()
        bench.feed(bench.host.read(64 * moment) if moment else b"")
        bench.host.run(0.05, reading=False)
        bench.plug()
        seen = len(bench.samples())
        bench.run(0.2)
        assert len(bench.samples()) > seen + 1000
    lost = sum(gap.lost for gap in bench.of(Gap))
    k = bench.samples()
    assert lost == (np.diff(k) % 65536 - 1).sum(), "every loss is told to the sample"
    assert lost < 3 * 1500, "of a short unplug the queue bridges all but one transfer"


def test_a_program_that_opens_the_port_late_gets_fresh_samples_and_no_loss(build):
    bench = Bench(build, rate=6660)
    bench.host.enumerate()
    bench.host.run(2.0, reading=False)
    made = bench.part.produced
    bench.host.open()
    bench.run(0.3)
    assert bench.samples()[0] > (made - 700) % 65536
    assert bench.of(Gap) == []


def test_a_program_that_opens_the_port_again_soon_loses_nothing(build):
    bench = Bench(build).plug()
    bench.run(0.5)
    bench.host.close()
    bench.host.run(0.5, reading=False)
    bench.host.open()
    bench.run(0.5)
    assert bench.of(Gap) == []
    assert (np.diff(bench.samples()) == 1).all()


# --- health -----------------------------------------------------------------------------------


def test_without_its_crystal_the_board_says_so(build):
    bench = Bench(build, crystal=False).plug()
    bench.run(0.2)
    assert bench.of(StreamInfo)[0].details["clock"] == "RC oscillator"


def test_after_the_watchdog_the_board_says_so(build):
    bench = Bench(build, hung=True).plug()
    bench.run(0.2)
    assert bench.said() == ["the device hung and its watchdog restarted it"]


def test_a_failed_self_test_is_said_and_samples_come_all_the_same(build):
    part = Lsm6dsm(one_data_line=True, interrupt=2)
    part.forces = (4000, 100)
    bench = Bench(build, part=part).plug()
    bench.run(0.5)
    assert bench.said() == [
        "the self-test of the gyroscope failed, or the board was moved during it"
    ]
    assert len(bench.samples()) > 20


def test_an_interrupt_that_never_comes_costs_no_sample(build):
    bench = Bench(build, part=Lsm6dsm(one_data_line=True)).plug()
    bench.run(1.0)
    assert len(bench.samples()) > 80
    assert bench.of(Gap) == []
    assert [text.partition(":")[0] for text in bench.said()] == [
        "the interrupt of the sensor does not come"
    ]


# --- the image --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def image(firmware, tmp_path_factory):
    """Return the folder with the image; `firmware` skips where there is no compiler."""
    out = tmp_path_factory.mktemp("image")
    command = ["make", "-s", "-C", str(DEVICE), "BOARD=sensortile", f"OUT={out}", "all"]
    subprocess.run(command, check=True)
    return out


def test_the_dfu_file_holds_the_image_for_the_flash(image):
    data, image = (image / "sensortile.dfu").read_bytes(), (image / "sensortile.bin").read_bytes()
    assert zlib.crc32(data[:-4]) ^ 0xFFFFFFFF == struct.unpack("<I", data[-4:])[0]
    product, vendor, version, mark, size = struct.unpack("<HHH3sB", data[-14:-4])
    assert (product, vendor, version, mark, size) == (0xDF11, 0x0483, 0x011A, b"UFD", 16)
    assert struct.unpack_from("<5sBIB", data) == (b"DfuSe", 1, len(data) - 16, 1)
    kind, _, _, _, size, elements = struct.unpack_from("<6sBI255sII", data, 11)
    assert (kind, size, elements) == (b"Target", 8 + len(image), 1)
    assert struct.unpack_from("<II", data, 285) == (0x08000000, len(image))
    assert data[293:-16] == image


def test_the_image_begins_with_a_stack_in_ram_and_a_handler_in_flash(image):
    stack, reset = struct.unpack_from("<II", (image / "sensortile.bin").read_bytes())
    assert stack == 0x20018000
    assert reset & 1
    assert 0x08000000 < reset < 0x08010000


def test_the_image_runs_on_an_emulated_processor_without_its_sensor(boards, tmp_path):
    """Start-up, vectors, tick and loop on a Cortex-M4; QEMU has no sensor and no USB."""
    elf, memory = tmp_path / "sensortile.elf", tmp_path / "memory"
    extra = ("BOARD=sensortile", f"OUT={tmp_path}", "EXTRA=-DUNIQUE_ID=0x08000000u")
    subprocess.run(["make", "-s", "-C", str(DEVICE), *extra, str(elf)], check=True)
    symbols = subprocess.run(["arm-none-eabi-nm", elf], capture_output=True, text=True, check=True)
    at = int(re.search(r"(\w+) b ring_bytes", symbols.stdout)[1], 16)
    command = ["qemu-system-arm", "-M", "b-l475e-iot01a", "-kernel", str(elf), "-display", "none"]
    with subprocess.Popen(
        [*command, "-serial", "null", "-monitor", "stdio"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    ) as machine:
        patience, events = Patience(machine), []
        while not patience.ended():
            time.sleep(0.5)
            machine.stdin.write(f'pmemsave {at} 4096 "{memory}"\n')
            machine.stdin.flush()
            data = memory.read_bytes() if memory.exists() else b""
            events = format_named("native").decoder(WireSettings()).feed(data, 0.0)
            if sum(e.kind == "status" for e in events if isinstance(e, Notice)) >= 2:
                break
        machine.kill()
    assert isinstance(events[0], StreamInfo)
    said = [e.text for e in events if isinstance(e, Notice) and e.kind in ("text", "error")]
    assert said[:2] == ["the sensor does not answer", "the sensor did not answer to its self-test"]
    status = [e.fields for e in events if isinstance(e, Notice) and e.kind == "status"]
    assert len(status) >= 2, "the loop turns and time goes on"


def test_code_memory_and_stack_leave_room(image, capsys):
    command = ["make", "-s", "-C", str(DEVICE), "BOARD=sensortile", f"OUT={image}", "report"]
    report = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    with capsys.disabled():
        print("\n" + report)
    text, data, bss = map(int, report.splitlines()[1].split()[:3])
    worst = int(re.search(r"worst stack: (\d+)", report)[1])
    assert text + data < 32 * 1024
    assert data + bss + worst < 64 * 1024
    assert worst < 2048


def test_a_function_that_calls_itself_has_no_worst_stack(tmp_path):
    sys.path.insert(0, str(DEVICE / "sensortile"))
    try:
        from worst_stack import deepest
    finally:
        sys.path.pop(0)
    assert deepest({"a": 8, "b": 16, "c": 4}, {"a": {"b", "c"}}, "a") == (24, ("a", "b"))
    with pytest.raises(SystemExit, match="recursion"):
        deepest({"a": 8}, {"a": {"b"}, "b": {"a"}}, "a")
