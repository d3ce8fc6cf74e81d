"""A recording made at once: complete, plausible, the same every time."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.errors import UsageError
from allanscope.samples import Block
from allanscope.simulator import Simulator, simulate_blocks
from allanscope.wire import WireSettings, format_named, formats

MINUTE = 1 / 60


def decode(reads, wire):
    decoder = format_named(wire).decoder(WireSettings("LSM6DSM", 104.0, 125.0, 2.0))
    events = [event for host_ns, data in reads for event in decoder.feed(data, host_ns * 1e-9)]
    return decoder.stats, [e for e in events + decoder.finish() if isinstance(e, Block)]


@pytest.mark.parametrize("rate", [26.0, 104.0, 6660.0])
def test_recording_holds_every_sample_of_its_time(rate):
    hours = MINUTE if rate < 1000 else MINUTE / 20
    sensor = Simulator(rate=rate, seed=2)
    stats, blocks = decode(simulate_blocks(hours, sensor), "native")
    counts = np.concatenate([block.counts for block in blocks])
    assert len(counts) == int(hours * 3600 * sensor.clock.true_hz)
    assert np.array_equal(counts, Simulator(rate=rate, seed=2).read(len(counts)).counts)
    assert stats.lost_samples == stats.crc_errors == stats.resyncs == 0


@pytest.mark.parametrize("wire", formats())
def test_every_wire_format_can_be_recorded(wire):
    _, blocks = decode(simulate_blocks(MINUTE, Simulator(clock_error=0.0), wire), wire)
    assert sum(map(len, blocks)) == pytest.approx(104 * 60, abs=104)


def test_host_times_ascend_and_give_the_true_rate():
    sensor = Simulator(rate=104.0, seed=3)
    reads = list(simulate_blocks(MINUTE * 10, sensor, start_ns=5_000_000_000))
    times = np.array([host_ns for host_ns, _ in reads])
    assert times[0] >= 5_000_000_000
    assert np.all(np.diff(times) >= 0)
    assert np.diff(times).max() < 0.2e9
    # Frames are read as a whole; in the last second, which ends with a short one, nearly so.
    assert all(data.endswith(b"\0") for host_ns, data in reads if host_ns < times[-1] - 1e9)
    _, blocks = decode(reads, "native")
    host = np.concatenate([block.ticks.host_s for block in blocks])
    index = np.concatenate([block.index + block.ticks.offset for block in blocks])
    assert np.polyfit(host, index, 1)[0] == pytest.approx(sensor.clock.true_hz, rel=2e-5)


def test_no_sample_is_read_before_it_was_taken():
    sensor = Simulator(rate=833.0, seed=3)
    _, blocks = decode(simulate_blocks(MINUTE, sensor), "native")
    for block in blocks:
        last = (block.index + len(block) - 1) / sensor.clock.true_hz
        assert block.ticks.host_s[-1] > last


def test_same_seeds_same_bytes():
    first, again = (b"".join(d for _, d in simulate_blocks(MINUTE)) for _ in range(2))
    assert first == again
    assert list(simulate_blocks(MINUTE)) == list(simulate_blocks(MINUTE))
    assert list(simulate_blocks(MINUTE)) != list(simulate_blocks(MINUTE, seed=1))


@pytest.mark.parametrize("hours", [0.0, -1.0, float("nan")])
def test_impossible_lengths_are_refused(hours):
    with pytest.raises(UsageError, match="cannot be made"):
        next(simulate_blocks(hours))
