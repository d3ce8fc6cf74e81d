"""Sensors of Linux IIO: settings by sysfs, scans to samples, losses counted by the times."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pytest

from allanscope.errors import DeviceError
from allanscope.samples import Block, Gap, StreamInfo
from allanscope.sources import IioSource, ScanElement, ScanLayout, describe_ports, scale_of
from allanscope.sources.iio import devices
from allanscope.sources.iio.scans import Numbering, pair
from allanscope.wire import WireSettings, format_named
from support.iio_tree import Driver, make_device, scans

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="IIO is of Linux")

N = 400
RATE = 106.3  # these parts are off by some per cent
RNG = np.random.default_rng(8)
GYRO = RNG.integers(-300, 300, (N, 3))
ACCEL = RNG.integers(-20, 20, (N, 3)) + np.array([0, 0, 16393])
TIMES = 1_790_000_000_000_000_000 + np.rint(np.arange(N) / RATE * 1e9).astype(np.int64)


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(devices, "SYSFS", tmp_path / "sys")
    monkeypatch.setattr(devices, "DEV", tmp_path / "dev")
    make_device(tmp_path, 0, "accel")
    make_device(tmp_path, 1, "gyro")
    return tmp_path


def text(root: Path, path: str) -> str:
    return (root / "sys" / path).read_text().strip()


def read(source: IioSource, samples: int, commands: list[bytes] | None = None) -> list[object]:
    """Return the events of so many samples, and give up after a while."""
    decoder = format_named("native").decoder(WireSettings())
    for command in commands or []:
        source.write(command)
    events: list[object] = []
    until = time.monotonic() + 60.0
    while decoder.stats.samples < samples and time.monotonic() < until:
        chunk = source.read()
        events += decoder.feed(chunk.data, chunk.host_ns * 1e-9)
    source.close()
    return events


def counts(events: list[object]) -> np.ndarray:
    return np.concatenate([one.counts for one in events if isinstance(one, Block)])


def info(events: list[object]) -> StreamInfo:
    return [one for one in events if isinstance(one, StreamInfo)][-1]


def test_two_devices_of_one_part_are_one_stream_of_six_axes(root):
    streams = {0: scans(ACCEL, TIMES + 40_000), 1: scans(GYRO, TIMES)}
    source = IioSource("iio")
    assert source.name == "iio:lsm6dsm"
    with Driver(root, streams):
        events = read(source, N)
    assert np.array_equal(counts(events), np.column_stack([GYRO, ACCEL]))
    assert not [one for one in events if isinstance(one, Gap)]
    stream = info(events)
    assert stream.part == "LSM6DSM"
    assert stream.nominal_hz == 104.0
    assert stream.origin == "measured"
    assert np.allclose(stream.scale, [8.75e-3] * 3 + [61e-6] * 3, rtol=1e-6)


def test_times_are_those_of_the_kernel(root):
    streams = {0: scans(ACCEL, TIMES), 1: scans(GYRO, TIMES)}
    with Driver(root, streams):
        events = read(IioSource("iio"), N)
    blocks = [one for one in events if isinstance(one, Block)]
    at = np.concatenate([one.index + one.ticks.offset for one in blocks])
    seconds = np.concatenate([one.ticks.device_s for one in blocks])
    assert len(at) >= N // 16
    assert np.abs(seconds - seconds[0] - (at - at[0]) / RATE).max() < 2e-6


def test_missing_scans_of_either_device_are_lost_samples(root):
    there = np.ones((2, N), bool)
    there[0, 50:53] = False
    there[1, 200] = False
    there[:, 300:340] = False
    streams = {
        0: scans(ACCEL[there[0]], TIMES[there[0]]),
        1: scans(GYRO[there[1]], TIMES[there[1]]),
    }
    kept = there.all(axis=0)
    with Driver(root, streams):
        events = read(IioSource("iio:lsm6dsm"), int(kept.sum()))
    assert np.array_equal(counts(events), np.column_stack([GYRO, ACCEL])[kept])
    assert [one.lost for one in events if isinstance(one, Gap)] == [3, 1, 40]


def test_what_the_host_asks_for_is_set_by_the_driver(root):
    settings = WireSettings(rate_hz=208.0, gyro_fs=500.0, accel_fs=8.0)
    source = IioSource("iio:device1")
    with Driver(root, {0: scans(ACCEL, TIMES), 1: scans(GYRO, TIMES)}):
        events = read(source, N, format_named("native").start(settings))
    for number, kind, scale in ((0, "accel", "0.002392822"), (1, "anglvel", "0.000305432")):
        assert text(root, f"iio:device{number}/sampling_frequency") == "208"
        assert text(root, f"iio:device{number}/in_{kind}_scale") == scale
    stream = info(events)
    assert stream.nominal_hz == 208.0
    assert np.allclose(stream.scale, [17.5e-3] * 3 + [0.244e-3] * 3, rtol=1e-6)


def test_a_buffer_is_set_up_before_it_is_on_and_off_at_the_end(root):
    source = IioSource("iio")
    for number, kind in ((0, "accel"), (1, "anglvel")):
        folder = f"iio:device{number}/"
        assert text(root, folder + "buffer/enable") == "1"
        assert text(root, folder + "buffer/length") == "416"
        assert text(root, folder + "current_timestamp_clock") == "monotonic"
        assert text(root, folder + f"scan_elements/in_{kind}_y_en") == "1"
        assert text(root, folder + "scan_elements/in_timestamp_en") == "1"
    source.close()
    assert source.read().event == "end"
    for number in (0, 1):
        assert text(root, f"iio:device{number}/buffer/enable") == "0"


def test_stop_switches_the_buffers_off_and_start_is_a_new_epoch(root):
    native = format_named("native")
    source = IioSource("iio")
    first = source._info.epoch
    source.write(native.stop()[0])
    source.read()
    assert text(root, "iio:device1/buffer/enable") == "0"
    source.write(native.start(WireSettings())[-1])
    source.read()
    assert text(root, "iio:device1/buffer/enable") == "1"
    assert source._info.epoch == first + 1
    source.close()


def test_a_driver_that_goes_and_comes_back_is_a_disconnect(root):
    now = [10**9]
    source = IioSource("iio", clock=lambda: now[0])
    away = root / "away"
    for name in ("iio:device0", "iio:device1"):
        (root / "dev" / name).rename(away.with_name(f"away_{name}"))
    assert source.read().event == "disconnected"
    now[0] += 2 * 10**9
    for name in ("iio:device0", "iio:device1"):
        assert source.read().event == ""
        away.with_name(f"away_{name}").rename(root / "dev" / name)
        now[0] += 2 * 10**9
    assert source.read().event == "reconnected"
    source.close()


def test_a_gyroscope_alone_is_read_too(root):
    for name in ("buffer", "scan_elements"):
        (root / "sys" / "iio:device0" / name).rename(root / name)
    with Driver(root, {1: scans(GYRO, TIMES)}):
        events = read(IioSource("iio"), N)
    assert info(events).axes == ("gx", "gy", "gz")
    assert np.array_equal(counts(events), GYRO)


def test_what_is_there_is_listed_and_what_is_not_is_said(root):
    assert any(line.startswith("iio:lsm6dsm  Linux IIO") for line in describe_ports(list))
    with pytest.raises(DeviceError, match="no sensor iio:bmi160; there is iio:lsm6dsm"):
        IioSource("iio:bmi160")
    (root / "dev" / "iio:device1").unlink()
    with pytest.raises(DeviceError, match=r"cannot open .*iio:device1: No such file"):
        IioSource("iio")
    assert text(root, "iio:device1/buffer/enable") == "0"


def test_counts_that_do_not_fit_are_refused(root):
    kind = root / "sys" / "iio:device1" / "scan_elements" / "in_anglvel_x_type"
    kind.write_text("be:s24/32>>8\n")
    with pytest.raises(DeviceError, match="counts of 24 bits"):
        IioSource("iio")
    kind.write_text("le:f32/32>>0\n")
    with pytest.raises(DeviceError, match="type 'le:f32/32>>0', which is not supported"):
        IioSource("iio")


@pytest.mark.parametrize(
    ("kind", "raw", "value"),
    [
        ("le:s16/16>>0", b"\x00\x80", -32768),
        ("be:s16/16>>0", b"\x12\x34", 0x1234),
        ("le:s12/16>>4", b"\xf0\xff", -1),
        ("le:u12/16>>4", b"\xf5\xff", 4095),
        ("be:s24/32>>8", b"\xff\xff\xfe\x55", -2),
        ("le:S20/32", b"\xff\xff\x07\xff", 0x7FFFF),
    ],
)
def test_the_bits_that_count_are_taken_with_their_sign(kind, raw, value):
    layout = ScanLayout((ScanElement.of("accel_x", 0, kind),))
    assert layout.counts(np.frombuffer(raw, layout.dtype)).tolist() == [[value]]


def test_elements_are_aligned_to_their_own_size():
    kinds = [("accel_x", "le:s16/16"), ("accel_y", "be:s24/32>>8"), ("timestamp", "le:s64/64")]
    layout = ScanLayout(tuple(ScanElement.of(one, i, kind) for i, (one, kind) in enumerate(kinds)))
    fields = layout.dtype.fields
    assert fields is not None
    assert [fields[name][1] for name, _ in kinds] == [0, 4, 8]
    assert layout.dtype.itemsize == 16


def test_a_scale_of_the_datasheet_is_taken_exactly_and_another_one_as_it_is():
    assert scale_of("ay", 0.000598, "LSM6DSL") == 0.061e-3  # with six decimals: 0.03 % off
    assert scale_of("gz", 0.001, "LSM6DSL") == pytest.approx(0.0572957795)


def test_pairs_are_of_one_moment():
    times, others = np.array([0, 100, 200, 300]), np.array([104, 190, 420])
    mine, partner = pair(times, others, 100.0)
    assert (mine.tolist(), partner.tolist()) == ([1, 2], [0, 1])


def test_a_long_gap_is_counted_by_the_period_that_was_measured():
    numbering = Numbering(1e9 / 104.0)
    assert numbering.runs(TIMES[:200]) == [(0, slice(0, 200))]
    (run,) = numbering.runs(TIMES[200:201] + round(1000 / RATE * 1e9))
    assert run == (1200, slice(0, 1))
    with pytest.raises(ValueError, match="go back"):
        numbering.runs(TIMES[:10])
