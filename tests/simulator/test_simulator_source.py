"""The simulated device as a source: bytes through a real port, and nothing left at the end."""

from __future__ import annotations

import os
import sys
import threading

import numpy as np
import pytest

from allanscope.errors import UsageError
from allanscope.samples import Block
from allanscope.simulator import Simulator
from allanscope.sources import SimulatedSource
from allanscope.wire import WireSettings, format_named

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

FAST = float("inf")


def read_blocks(source, samples):
    decoder = format_named("native").decoder(WireSettings())
    blocks = []
    for _ in range(20_000):
        chunk = source.read()
        found = decoder.feed(chunk.data, chunk.host_ns * 1e-9)
        blocks += [event for event in found if isinstance(event, Block)]
        if decoder.stats.samples >= samples:
            return decoder.stats, blocks
    pytest.fail("the source fell silent")


def test_source_gives_the_samples_of_the_sensor_at_the_highest_rate():
    source = SimulatedSource(sensor=Simulator(rate=6660.0, seed=1), speed=FAST)
    try:
        stats, blocks = read_blocks(source, 30_000)
    finally:
        source.close()
    end = blocks[-1].index + len(blocks[-1])
    truth = Simulator(rate=6660.0, seed=1).read(end).counts
    for block in blocks:
        assert np.array_equal(block.counts, truth[block.index : block.index + len(block)])
    # A busy machine may be too slow for a board without a brake; then it is told, to the sample.
    assert sum(map(len, blocks)) + stats.lost_samples == end


def test_source_passes_on_what_the_host_says():
    source = SimulatedSource(speed=FAST)
    try:
        for message in format_named("native").start(WireSettings()):
            source.write(message)
        for _ in range(1000):
            if source.device.ledger.commands == 2:
                break
            source.read()
        assert source.device.ledger.commands == 2
        assert source.name == "sim"
        assert source.identity["path"] == source.device.url
    finally:
        source.close()


def test_source_survives_a_pulled_cable():
    source = SimulatedSource(
        sensor=Simulator(rate=104.0), speed=FAST, faults=["unplug:at=3,seconds=2"]
    )
    events = []
    try:
        for _ in range(2000):
            events.append(source.read().event)
            if "reconnected" in events:
                break
        assert [event for event in events if event] == ["disconnected", "reconnected"]
        read_blocks(source, 100)
    finally:
        source.close()


def test_close_leaves_no_thread_no_file_and_no_port():
    threads, files = threading.active_count(), len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        source = SimulatedSource(speed=50.0)
        read_blocks(source, 50)
        source.close()
        assert source.read().event == "end"
        assert not os.path.lexists(source.device.url)
    assert threading.active_count() == threads
    assert len(os.listdir("/proc/self/fd")) == files


def test_close_ends_a_read_in_another_thread():
    source = SimulatedSource(wire="tmsg")  # silent: nobody starts it
    events = []

    def read_on():
        while not events:
            event = source.read().event
            events.extend([event] if event else [])

    reader = threading.Thread(target=read_on)
    reader.start()
    source.close()
    reader.join(10.0)
    assert events == ["end"]


def test_a_wire_that_does_not_exist_leaves_nothing_behind():
    threads = threading.active_count()
    with pytest.raises(UsageError, match="unknown wire format"):
        SimulatedSource(wire="morse")
    assert threading.active_count() == threads
