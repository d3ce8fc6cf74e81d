"""`open_stream`: a device's samples in a loop, from the simulator, a pty and a file."""

import time

import pytest

from allanscope import AXES, AllanBank, Block, DeviceError, Gap, UsageError, open_stream
from allanscope.__main__ import main
from allanscope.pipeline import Decoding, Stream
from allanscope.recording import Chunk
from allanscope.simulator import Device, Simulator
from allanscope.wire import WireSettings, format_named


def rows_of(stream, n):
    """Read until there are n rows; return the blocks."""
    blocks = []
    for item in stream:
        assert isinstance(item, Block | Gap)
        if isinstance(item, Block):
            blocks.append(item)
        if sum(map(len, blocks)) >= n:
            break
    return blocks


def test_the_simulated_device_feeds_a_bank():
    with open_stream("sim", rate=833.0, gyro_fs=500.0) as stream:
        assert stream.info.axes == AXES
        assert stream.info.nominal_hz == 833.0
        assert stream.info.scale[0] == 17.5e-3
        bank = AllanBank(stream.info.nominal_hz, scale=stream.info.scale)
        for block in rows_of(stream, 300):
            bank.update(block)
        assert bank.samples == stream.stats.samples >= 300
    assert bank.deviation("oadev").deviation.shape[0] == 6
    assert list(stream) == []


@pytest.mark.parametrize("wire", ["native", "tmsg", "datalog"])
def test_a_device_on_a_port_is_started_read_and_stopped(wire):
    device = Device(Simulator(rate=104.0), wire).start()
    try:
        with open_stream(device.url) as stream:
            blocks = rows_of(stream, 40)
            assert stream.name == device.url
            assert stream.info.wire == wire
        assert blocks[0].counts.shape[1] == len(stream.info.axes)
    finally:
        device.stop()


def test_a_file_ends_by_itself(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("gx[dps],gy[dps]\n" + "0.5,0.25\n" * 99 + "0.5,0.25")
    stream = open_stream(str(path), rate=50.0)
    assert sum(len(item) for item in stream) == 100
    assert stream.info.nominal_hz == 50.0


def test_a_recording_gives_the_same_samples_again(tmp_path):
    path = tmp_path / "night.mcap"
    assert main(["simulate", str(path), "--hours", "0.002", "--quiet"]) == 0
    first = [item.counts.tobytes() for item in open_stream(str(path)) if isinstance(item, Block)]
    again = [item.counts.tobytes() for item in open_stream(str(path)) if isinstance(item, Block)]
    assert b"".join(first) == b"".join(again) != b""


class Silent:
    """A source that never says anything."""

    name = "mute"

    def __init__(self):
        self.closed = False

    def read(self):
        return Chunk(0)

    def close(self):
        self.closed = True


class Pausing(Silent):
    """A source that speaks, is silent for longer than the patience, and speaks again."""

    def __init__(self):
        super().__init__()
        rows = b"gx[dps]\n" + b"0.5\n" * 40
        self._chunks = [Chunk(1, rows), *[Chunk(1)] * 3, Chunk(1, b"0.25\n" * 10)]

    def read(self):
        time.sleep(0.02)
        return self._chunks.pop(0) if self._chunks else Chunk(1, event="end")


def test_a_device_that_has_spoken_may_fall_silent():
    stream = Stream(Pausing(), Decoding(WireSettings(rate_hz=50.0)), patience_s=0.03)
    assert sum(len(block) for block in stream) == 50


def test_a_device_is_told_to_stop_once_and_its_port_is_closed():
    said, source = [], Silent()
    with Stream(source, Decoding(WireSettings(), "tmsg", said.append), patience_s=1.0) as stream:
        stream.close()
        assert source.closed
    assert said == format_named("tmsg").stop()


def test_a_silent_port_is_given_up():
    stream = Stream(Silent(), Decoding(WireSettings()), patience_s=0.05)
    with pytest.raises(DeviceError, match="mute: no samples received"):
        next(stream)
    with pytest.raises(DeviceError, match="mute: no samples received"):
        _ = stream.info


def test_ports_and_words_that_do_not_exist():
    with pytest.raises(DeviceError, match="ttyNothing"):
        open_stream("/dev/ttyNothing")
    with pytest.raises(UsageError, match="LSM9DS1"):
        open_stream("sim", part="LSM9DS1")
