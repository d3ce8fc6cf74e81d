"""The driver of the real part, against a register-accurate model of it."""

import numpy as np
import pytest

from support.lsm6dsm_driver import Driver, numbers
from support.lsm6dsm_model import Lsm6dsm


@pytest.mark.parametrize(
    ("config", "ctrl1", "ctrl2"),
    [
        ((104.0, 250.0, 2.0), 0x40, 0x40),
        ((6660.0, 2000.0, 16.0), 0xA4, 0xAC),
        ((12.5, 125.0, 4.0), 0x18, 0x12),
        ((416.0, 500.0, 8.0), 0x6C, 0x64),
        ((833.0, 1000.0, 2.0), 0x70, 0x78),
    ],
)
def test_registers_are_set_as_the_datasheet_says(library, config, ctrl1, ctrl2):
    part = Lsm6dsm()
    driver = Driver(library, part)
    assert driver.configure(*config)
    told = driver.registers()
    assert (told[0x10], told[0x11]) == (ctrl1, ctrl2)
    assert told[0x12] & 0x40, "block data update keeps both bytes of one sample together"
    assert told[0x0A] & 7 == 6, "FIFO in continuous mode"
    assert told[0x0A] >> 3 == ctrl2 >> 4, "FIFO at the ODR of the sensors"
    assert told[0x5C] & 0x10, "time stamp of 25 us"


def test_what_the_part_cannot_do_is_refused_and_nothing_is_written(library):
    part = Lsm6dsm()
    driver = Driver(library, part)
    assert not driver.configure(rate=150.0)
    assert not driver.configure(gyro_fs=300.0)
    assert not driver.configure(accel_fs=3.0)
    assert part.writes == []


def test_a_foreign_or_absent_part_is_refused(library):
    part = Lsm6dsm()
    part.registers[0x0F] = 0x69
    assert not Driver(library, part).configure()
    part.answers = False
    assert not Driver(library, part).configure()


@pytest.mark.parametrize("off", [0.0, -0.044, 0.07])
def test_every_sample_comes_once_and_in_order_whatever_the_true_rate(library, off):
    part = Lsm6dsm(off)
    driver = Driver(library, part)
    driver.configure(rate=416.0)
    got, lost = [], 0
    for _ in range(400):
        part.advance(0.02)
        while True:
            answered, batch = driver.read()
            assert answered
            lost += batch.lost_before
            got += numbers(batch)
            if batch.n < 16:
                break
    assert lost == 0
    assert got == list(range(got[0], got[0] + len(got)))
    assert got[0] == 17, "the first after a change of mode and 16 of the settling filter are void"
    assert len(got) == part.produced - 17


@pytest.mark.parametrize("rate", [104.0, 6660.0])
def test_an_overrun_is_told_to_the_sample_and_axes_do_not_shift(library, rate):
    part = Lsm6dsm(0.03)
    driver = Driver(library, part)
    driver.configure(rate=rate)
    expected, lost = None, 0
    for step in range(60):
        # Every tenth time the host is late by more than the FIFO holds (2048 words, 227 samples).
        part.advance(400.0 / rate if step % 10 == 9 else 16.0 / rate)
        while True:
            _, batch = driver.read()
            for k in numbers(batch):
                if expected is not None:
                    lost_here = k - expected
                    assert lost_here == (batch.lost_before if k == numbers(batch)[0] else 0)
                    lost += lost_here
                expected = k + 1
            if batch.n < 16:
                break
    assert lost > 0


@pytest.mark.parametrize("phase", [0.1, 0.3, 0.5, 0.7, 0.9])
@pytest.mark.parametrize("periods", [0.2, 0.9])
def test_a_fifo_that_runs_over_while_it_is_read_mixes_no_samples(library, phase, periods):
    """A sample comes while the first sets of a full FIFO are read: it takes their words away."""
    part = Lsm6dsm()
    driver = Driver(library, part)
    driver.configure(rate=6660.0)

    def slowly(register, n):
        if register != 0x3E:
            return Lsm6dsm.read(part, register, n)
        words = []
        for _ in range(n // 2):
            words.append(Lsm6dsm.read(part, register, 2))
            part.advance(periods / 9 / 6660.0)
        return b"".join(words)

    last = None
    for _ in range(20):
        part.advance((300.0 + phase) / 6660.0)
        part.read = slowly
        for _ in range(6):
            _, batch = driver.read()
            found = numbers(batch)
            assert found == list(range(found[0], found[-1] + 1)) if found else True
            if last is not None and found:
                assert found[0] - last - 1 == batch.lost_before
            last = found[-1] if found else last
        del part.read
    assert last > 5000


@pytest.mark.parametrize("ticks_off", [-0.004, 0.004])
@pytest.mark.parametrize("rate", [104.0, 6660.0])
def test_a_long_overrun_is_counted_by_the_period_as_it_was_measured(library, rate, ticks_off):
    """By the nominal one 5000 samples would be 20 off."""
    part = Lsm6dsm(ticks_off=ticks_off)
    driver = Driver(library, part)
    driver.configure(rate=rate)
    last = lost = 0
    for late in [*[16] * 1200, 5000, *[16] * 40, 3000, 16]:
        part.advance(late / rate)
        while True:
            _, batch = driver.read()
            for k in numbers(batch):
                if last and k > last + 1:
                    assert batch.lost_before == k - last - 1
                    lost += batch.lost_before
                last = k
            if batch.n < 16:
                break
    assert lost > 7000


def test_a_batch_tells_how_many_samples_wait_behind_it(library):
    part = Lsm6dsm()
    driver = Driver(library, part)
    driver.configure(rate=104.0)
    part.advance(1.0)
    driver.read()
    part.advance(40.5 / 104.0)
    found = [driver.read()[1] for _ in range(12)]
    sizes = [(batch.n, batch.behind) for batch in found if batch.n]
    assert sizes[-1][1] == 0
    assert [n + behind for n, behind in sizes[1:]] == [behind for _, behind in sizes[:-1]]


def test_the_time_stamp_is_unwrapped_across_its_24_bits(library):
    part = Lsm6dsm()
    driver = Driver(library, part)
    driver.configure(rate=12.5)
    stamps = []
    for _ in range(9000):
        part.advance(0.08)
        _, batch = driver.read()
        if batch.n:
            assert batch.lost_before == 0
            stamps.append(batch.sensor_time)
    steps = np.diff(np.array(stamps, np.int64))
    assert set(steps.tolist()) == {3200}
    assert stamps[-1] > 1 << 24


def test_a_part_that_falls_silent_is_an_error_and_not_a_wrong_sample(library):
    part = Lsm6dsm()
    driver = Driver(library, part)
    driver.configure()
    part.advance(1.0)
    part.answers = False
    assert driver.read()[0] is False
    part.answers = True
    answered, batch = driver.read()
    assert answered
    assert batch.temperature == 0x0180


def test_an_empty_fifo_gives_no_sample(library):
    driver = Driver(library, Lsm6dsm())
    driver.configure()
    answered, batch = driver.read()
    assert answered
    assert batch.n == 0


def test_an_lsm6ds3h_is_driven_too(library):
    """Its identity, its switch of the time stamp, its temperature and its fastest rate differ."""
    part = Lsm6dsm(who_am_i=0x69)
    driver = Driver(library, part, "ds3h")
    assert not driver.configure(rate=3330.0)
    assert part.writes == []
    assert driver.configure(rate=1660.0)
    part.advance(0.05)
    assert driver.read()[1].n == 16
    stamps = []
    for _ in range(3):
        part.advance(16 / 1660.0)
        _, batch = driver.read()
        assert batch.lost_before == 0
        stamps.append(batch.sensor_time)
        numbers(batch)
    assert set(np.diff(stamps)) <= {385, 386}
    assert (driver.imu.who_am_i, driver.imu.counts_per_degc) == (0x69, 16.0)
    assert not Driver(library, Lsm6dsm(), "ds3h").configure(), "0x6A is no LSM6DS3H"


@pytest.mark.parametrize(
    ("forces", "verdict"), [((4000, 5000), 0), ((700, 5000), 2), ((4000, 11000), 3), ((4000, 0), 3)]
)
def test_the_self_test_moves_every_axis_by_what_the_datasheet_allows(library, forces, verdict):
    part = Lsm6dsm()
    part.forces = forces
    driver = Driver(library, part)
    assert driver.self_test() == verdict
    assert driver.configure()
    assert not part.registers.get(0x14), "no force is left on"


def test_a_part_that_does_not_answer_fails_its_self_test_as_such(library):
    part = Lsm6dsm()
    part.answers = False
    assert Driver(library, part).self_test() == 1


@pytest.mark.parametrize("pin", [1, 2])
@pytest.mark.parametrize("rate", [12.5, 104.0, 6660.0])
def test_the_interrupt_rises_when_a_frame_has_gathered(library, rate, pin):
    part = Lsm6dsm(interrupt=pin)
    driver = Driver(library, part)
    assert driver.configure(rate=rate)
    frame = driver.imu.watermark
    part.advance((frame + 0.5) / rate)
    assert len(part.edges) == 1
    while part.fifo:
        driver.read()
    for _ in range(5):
        seen = len(part.edges)
        part.advance((frame - 1) / rate)
        assert len(part.edges) == seen
        part.advance(1 / rate)
        assert len(part.edges) == seen + 1
        assert driver.read(frame)[1].n + driver.read(frame)[1].n <= frame


def test_the_temperature_comes_as_the_part_gives_it(library):
    part = Lsm6dsm()
    driver = Driver(library, part)
    driver.configure()
    for part.temperature in (0, 0x7FFF, -256):
        part.advance(0.1)
        assert driver.read()[1].temperature == part.temperature
