"""The device behind every wire format: started as the format wants it, read by its decoder."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.samples import Block, StreamInfo
from allanscope.simulator import Firmware, Simulator, parse_fault
from allanscope.wire import WireSettings, answers, format_named, formats

RATE = 52.0


class Link:
    """Firmware and decoder of one format; the test carries the bytes."""

    def __init__(self, wire, *faults):
        self.sensor = {"rate": RATE, "seed": 4, "gyro_fs": 250.0, "clock_error": 0.0}
        specs = [parse_fault(fault) for fault in faults]
        self.firmware = Firmware(Simulator(**self.sensor), wire, specs)
        self.format = format_named(wire)
        self.settings = WireSettings("LSM6DSM", RATE, 250.0, 2.0)
        self.decoder = self.format.decoder(self.settings)
        self.events = []
        self.firmware.host_connected()

    def hear(self, seconds):
        """Let time pass and return how many bytes came."""
        end_s, total = self.firmware.now_s + seconds, 0
        while self.firmware.now_s < end_s:
            self.firmware.advance(min(end_s, self.firmware.now_s + 0.05))
            while data := self.firmware.pending():
                self.firmware.written(len(data))
                self.events += self.decoder.feed(data, self.firmware.now_s)
                total += len(data)
        return total

    def start(self):
        messages = self.format.start(self.settings)
        while messages:
            for message in messages:
                self.firmware.receive(message)
            self.hear(0.01)
            messages = answers(self.decoder)

    @property
    def values(self):
        """Everything that came, in physical units, in the columns of the last StreamInfo."""
        self.events += self.decoder.finish()
        scale = next(e for e in reversed(self.events) if isinstance(e, StreamInfo)).scale
        return np.concatenate([e.counts for e in self.events if isinstance(e, Block)]) * scale


@pytest.mark.parametrize("wire", formats())
def test_a_device_is_silent_until_started_where_its_format_is(wire):
    link = Link(wire)
    silent = format_named(wire).encoder().silent_until_started
    assert (link.hear(3.0) == 0) == silent
    link.start()
    assert link.hear(3.0) > 0


@pytest.mark.parametrize("wire", formats())
def test_values_arrive_to_the_step_of_the_format(wire):
    link = Link(wire)
    link.start()
    link.hear(20.0)
    values = link.values
    sensor = Simulator(**link.sensor)
    made = sensor.read(len(values)).counts * sensor.info.scale
    assert len(values) > 19 * RATE
    step = np.array([8.75e-3] * 3 + [1e-3] * 3)  # stock firmware cuts to whole mg
    assert np.all(np.abs(values - made) < step + 1e-9)


@pytest.mark.parametrize("wire", [w for w in formats() if format_named(w).stop()])
def test_stop_is_obeyed(wire):
    link = Link(wire)
    link.start()
    link.hear(2.0)
    for message in link.format.stop():
        link.firmware.receive(message)
    link.hear(0.1)
    assert link.hear(3.0) == 0


@pytest.mark.parametrize("wire", ["native", "tmsg", "tmsg-sensortile"])
def test_single_bit_flips_destroy_the_frames_that_the_ledger_names(wire):
    link = Link(wire, "bit_flip:rate=3e-4")
    link.start()
    link.hear(60.0)
    ledger = link.firmware.ledger
    assert ledger.damaged > 20
    assert len(link.values) == ledger.produced - ledger.damaged


def test_a_sound_message_between_two_damaged_ones_is_kept():
    """With hundredths of a second at 52 Hz its time alone could be anybody's."""
    link = Link("tmsg-sensortile", "bit_flip:rate=3e-4")
    link.start()
    link.hear(12.0)
    lost = {loss.first for loss in link.firmware.ledger.losses}
    assert {468, 470} <= lost
    assert 469 not in lost
    values = link.values
    assert link.decoder.stats.resyncs == 0
    runs = [e for e in link.events if isinstance(e, Block) and e.index <= 469 < e.index + len(e)]
    assert len(runs) == 1
    made = Simulator(**link.sensor).read(len(values) + len(lost)).counts[469, :3]
    assert runs[0].counts[469 - runs[0].index, :3].tolist() == made.tolist()


@pytest.mark.parametrize("fault", ["bit_flip", "byte_loss", "byte_repeat", "garbage"])
@pytest.mark.parametrize("wire", [wire for wire in formats() if wire != "native"])
def test_what_arrives_and_what_is_reported_lost_is_all_that_was_made(wire, fault):
    """At 52 Hz the stamps of every format can count, also where digits were changed."""
    link = Link(wire, f"{fault}:rate=1e-4")
    link.start()
    link.hear(40.0)
    arrived, stats = len(link.values), link.decoder.stats
    assert stats.unknown_losses == 0
    at_the_ends = link.firmware.ledger.produced - arrived - stats.lost_samples
    assert 0 <= at_the_ends <= 2


def test_tmsg_streams_the_sensors_that_were_asked_for():
    link = Link("tmsg")
    for message in link.format.start(link.settings)[:-1]:
        link.firmware.receive(message)
    from allanscope.wire.tmsg.messages import wrap

    link.firmware.receive(wrap(bytes([50, 1, 8, 0x20, 0, 0, 0])))  # gyro only
    link.hear(2.0)
    link.events += link.decoder.finish()
    info = next(e for e in link.events if isinstance(e, StreamInfo))
    assert info.axes == ("gx", "gy", "gz")
