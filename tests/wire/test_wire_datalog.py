"""ST's DataLog text, byte for byte as the firmware prints it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from allanscope.errors import UsageError
from allanscope.samples import AXES, Block, Event, Gap, StreamInfo, Ticks
from allanscope.wire import WireSettings, format_named
from allanscope.wire.datalog import CLOCK, COUNTER, RecordReader
from allanscope.wire.milli_units import MilliUnits, recover, truncate
from allanscope.wire.rows import Row

V2 = (
    "TimeStamp: {t}\r\n Acc_X: {a[0]}, Acc_Y: {a[1]}, Acc_Z :{a[2]}\r\n"
    " Gyro_X:{g[0]}, Gyro_Y:{g[1]}, Gyro_Z:{g[2]}\r\n Magn_X:-101, Magn_Y:230, Magn_Z:-55\r\n"
    " Press: 987.54, Temp:{c:5.2f}, Hum:40.1\r\n"
)
V1 = (
    "\nTimeStamp: 23:59:{s:02d}.{h:02d}\n\rACC_X: {a[0]}, ACC_Y: {a[1]}, ACC_Z: {a[2]}"
    "\n\rGYR_X: {g[0]}, GYR_Y: {g[1]}, GYR_Z: {g[2]}\n\rMAG_X: 1, MAG_Y: 2, MAG_Z: 3"
    "\n\rHUM: 40.05\n\rTEMP: {c}\n\rPRESS: 987.54\n\rV: 3712mV Chrg: 81%"
)


def _records(count: int, start: int = 1000, accel: int = 1, gyro: int = 70) -> bytes:
    rng = np.random.default_rng(3)
    text = ""
    for i in range(count):
        a = (np.trunc(rng.integers(-20, 20, 3) * accel)).astype(int)
        g = (rng.integers(-3, 4, 3) * gyro).tolist()
        stamp = (start + 20 * i + 2**31) % 2**32 - 2**31
        text += V2.format(t=stamp, a=a.tolist(), g=g, c=24.5)
    return text.encode()


def test_a_record_is_read_as_the_firmware_prints_it(fed: Callable[..., list[Event]]) -> None:
    text = "".join(
        V2.format(t=1000 + 20 * i, a=(-3 + i, 12, 1001), g=(-280, 490, -70), c=-3.25)
        for i in range(3)
    )
    info, block = fed(format_named("datalog").decoder(WireSettings()), text.encode())
    assert isinstance(info, StreamInfo)
    assert isinstance(block, Block)
    assert info.scale == (0.07, 0.07, 0.07, 1e-3, 1e-3, 1e-3)
    assert info.truncated == (False,) * 3 + (True,) * 3
    assert block.counts.tolist() == [[-4, 7, -1, -3 + i, 12, 1001] for i in range(3)]
    assert block.ticks.device_s.tolist() == [1.0, 1.02, 1.04]
    assert block.ticks.temperature_c.tolist() == [-3.25] * 3


def test_version_1_separates_with_lf_cr_before_each_line(fed: Callable[..., list[Event]]) -> None:
    text = "".join(
        V1.format(s=59, h=94 + 2 * i, a=(1, -2, 1000), g=(70, -140, 0), c="0.-50") for i in range(3)
    )
    text += V1.format(s=0, h=0, a=(1, -2, 1000), g=(70, -140, 0), c="24.05").replace(
        "23:59", "00:00"
    )
    info, block = fed(format_named("datalog11").decoder(WireSettings()), text.encode())
    assert isinstance(info, StreamInfo)
    assert isinstance(block, Block)
    assert block.counts.tolist() == [[1, -2, 0, 1, -2, 1000]] * 4
    assert np.diff(block.ticks.device_s) == pytest.approx([0.02] * 3)
    assert block.ticks.temperature_c.tolist() == [-0.5, -0.5, -0.5, 24.05]
    assert info.nominal_hz == 0.0  # four records do not show a rate


def test_the_rate_is_one_that_the_firmware_has() -> None:
    decoder = format_named("datalog").decoder(WireSettings())
    info = decoder.feed(_records(40), 0.0)[0]
    assert isinstance(info, StreamInfo)
    assert info.nominal_hz == 50.0
    asked = format_named("datalog").decoder(WireSettings(rate_hz=52.0))
    info = asked.feed(_records(40), 0.0)[0]
    assert isinstance(info, StreamInfo)
    assert info.nominal_hz == 52.0


def test_time_stamps_wrap_and_are_negative_after_24_days(fed: Callable[..., list[Event]]) -> None:
    for start in (2**31 - 400, 2**32 - 400):
        decoder = format_named("datalog").decoder(WireSettings())
        events = fed(decoder, _records(40, start=start))
        assert [type(event) for event in events] == [StreamInfo, Block]
        assert np.ptp(events[1].ticks.device_s) == pytest.approx(0.78)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("asked", "step", "scale"),
    [
        (None, 70, 0.07),
        (2000.0, 70, 0.07),
        (1000.0, 35, 0.035),
        (1000.0, 70, 0.035),
        (None, 35, 0.035),
        (2000.0, 35, 0.035),
        (None, 1, 0.001),
    ],
)
def test_the_full_scale_is_the_users_unless_the_numbers_forbid_it(
    asked: float | None, step: int, scale: float
) -> None:
    decoder = format_named("datalog").decoder(WireSettings(gyro_fs=asked))
    info = decoder.feed(_records(40, gyro=step), 0.0)[0]
    assert isinstance(info, StreamInfo)
    assert info.scale[0] == scale
    assert info.truncated[0] == (step == 1)


def test_a_full_scale_that_no_part_has_is_refused() -> None:
    with pytest.raises(UsageError, match="no gyro full scale of 245"):
        format_named("datalog").decoder(WireSettings(gyro_fs=245.0))


def test_the_accelerometer_of_version_2_0_is_told_by_its_steps() -> None:
    counts = np.random.default_rng(5).integers(-40, 40, (60, 6)).astype(np.int16)
    encoder = format_named("datalog").encoder()
    encoder.describe(StreamInfo(AXES, (0.07,) * 3 + (3.9e-3,) * 3, 50.0))
    text = encoder.encode(Block(0, counts, Ticks.none()))
    info, block = format_named("datalog").decoder(WireSettings()).feed(text, 0.0)
    assert isinstance(info, StreamInfo)
    assert isinstance(block, Block)
    assert info.scale[3:] == (3.9e-3,) * 3
    assert info.truncated == (False,) * 6
    np.testing.assert_array_equal(block.counts, counts[: len(block)])


def test_few_levels_do_not_prove_an_accelerometer() -> None:
    text = "".join(
        V2.format(t=20 * i, a=(0, 3 * (i % 2), 1002), g=(0, 0, 0), c=25.0) for i in range(40)
    )
    info = format_named("datalog").decoder(WireSettings()).feed(text.encode(), 0.0)[0]
    assert isinstance(info, StreamInfo)
    assert info.scale[3] == 1e-3


def test_a_finer_range_that_shows_late_is_a_new_configuration() -> None:
    quiet = "".join(
        V2.format(t=20 * i, a=(0, 0, 1000), g=(35 * (i > 30 and i % 2), 0, 70), c=25.0)
        for i in range(80)
    )
    decoder = format_named("datalog").decoder(WireSettings())
    events = decoder.feed(quiet.encode(), 0.0) + decoder.finish()
    infos = [event for event in events if isinstance(event, StreamInfo)]
    assert [info.scale[0] for info in infos] == [0.07, 0.035]
    assert [info.epoch for info in infos] == [1, 2]
    assert Gap("restarted", None) in events


@pytest.mark.parametrize("place", [0, 12, 40])
def test_one_damaged_number_is_no_new_configuration(place: int) -> None:
    text = "".join(
        V2.format(t=20 * i, a=(0, 0, 1000), g=(35 if i == place else 70, 0, -70), c=25.0)
        for i in range(60)
    )
    decoder = format_named("datalog").decoder(WireSettings())
    events = decoder.feed(text.encode(), 0.0) + decoder.finish()
    infos = [event for event in events if isinstance(event, StreamInfo)]
    assert [info.scale[0] for info in infos] == [0.07]
    assert decoder.stats.samples == 59
    assert decoder.stats.lost_samples == (place > 0)


@pytest.mark.parametrize("micro", [4375, 8750, 17500, 35000, 70000, 61, 122, 244, 488, 3900])
def test_scaling_and_cutting_is_exact(micro: int) -> None:
    counts = np.arange(-32768, 32768)
    exact = np.sign(counts) * (np.abs(counts) * micro // 1000)
    np.testing.assert_array_equal(truncate(counts, micro / 1000), exact)
    if micro > 1000:
        np.testing.assert_array_equal(recover(exact, micro / 1000), counts)


@pytest.mark.parametrize(
    "damage",
    [
        "TimeStamp: 12\r\n Acc_X: 1, Acc_Y: 2, Acc_Z :3\r\n",  # no gyroscope
        "TimeStamp: 12\r\n Gyro_X:0, Gyro_Y:0, Gyro_Z:0\r\n",  # no accelerometer
        " Acc_X: 1, Acc_Y: 2, Acc_Z :3\r\n Gyro_X:0, Gyro_Y:0, Gyro_Z:0\r\n",  # no time
        "TimeStamp: 12\r\n Acc_X: 1, Acc_Y: 2, Acc_\r\n Gyro_X:0, Gyro_Y:0, Gyro_Z:0\r\n",  # torn
        "TimeStamp: 12\r\n Acc_X: 1, Acc_X: 2, Acc_Z :3\r\n Gyro_X:0, Gyro_Y:0, Gyro_Z:0\r\n",
        "TimeStamp: 12\r\n Gyro_X:0, Gyro_Y:0, Gyro_Z:0\r\n Acc_X: 1, Acc_Y: 2, Acc_Z :3\r\n",
        "TimeStamp: \r\n Acc_X: 1, Acc_Y: 2, Acc_Z :3\r\n Gyro_X:0, Gyro_Y:0, Gyro_Z:0\r\n",
        "TimeStamp: 12 Acc_X: 1, Acc_Y: 2, Acc_Z :3\r\n Gyro_X:0, Gyro_Y:0, Gyro_Z:0\r\n",
        "Sending: Press=1013 Hum=40 Temp=25 Temp2=25 \r\n",
    ],
)
def test_a_torn_record_is_no_record(damage: str) -> None:
    reader = RecordReader(COUNTER)
    records = [reader.line(line.encode()) for line in damage.split("\r\n") if line]
    assert [*records, reader.flush()] == [None] * (len(records) + 1)
    assert reader.damaged >= 1


def test_the_two_generations_do_not_pass_for_each_other() -> None:
    two, one = _records(3), V1.format(s=1, h=2, a=(1, 2, 3), g=(0, 0, 0), c="1.00").encode()
    assert format_named("datalog").score(two) == 1.0
    assert format_named("datalog").score(one) == 0.0
    assert format_named("datalog11").score(one) == 1.0
    assert format_named("datalog11").score(two) == 0.0
    assert CLOCK.fullmatch(b"TimeStamp: 12:34:56.78")


def test_a_sensor_that_is_switched_off_leaves_its_axes_out() -> None:
    units = MilliUnits("tmsg", WireSettings(), (104.0,), 1e-6)
    nan = float("nan")
    rows = [Row((70.0, 0.0, -70.0, nan, nan, nan), 0.01 * i, 0.0) for i in range(25)]
    meaning = units.decide(rows)
    assert meaning.info.axes == ("gx", "gy", "gz")
    counts, agree = meaning.convert(np.array([rows[0].values, (70.0, 1.0, 0.0, nan, nan, nan)]))
    assert counts[0].tolist() == [1, 0, -1]
    assert agree.tolist() == [True, False]
