"""Faults on the line, the ring, and what the ledger says of them: sans-IO, to the sample."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from allanscope.errors import UsageError
from allanscope.samples import Block, Gap
from allanscope.simulator import Firmware, Ledger, Loss, Simulator, fault_help, parse_fault
from allanscope.simulator.faults import FAULT_KINDS, LineNoise, Occurrences
from allanscope.wire import WireSettings, format_named


class Bench:
    """A native device and a decoder, with a wire between them that the test holds."""

    def __init__(self, *faults, rate=1660.0, seed=3, ring_bytes=65536):
        specs = [parse_fault(fault) for fault in faults]
        sensor = Simulator(rate=rate, seed=seed)
        self.firmware = Firmware(sensor, faults=specs, seed=seed, ring_bytes=ring_bytes)
        self.decoder = format_named("native").decoder(WireSettings())
        self.events = []
        self.firmware.host_connected()

    @property
    def ledger(self):
        return self.firmware.ledger

    def run(self, seconds, *, step_s=0.01):
        """Let time pass and carry every byte; on an unplug come back when the device does."""
        end_s = self.firmware.now_s + seconds
        while self.firmware.now_s < end_s:
            self.firmware.advance(min(end_s, self.firmware.now_s + step_s))
            if not self.firmware.plugged:
                self.firmware.host_disconnected(0)
                self.events += self.decoder.interrupt("disconnected")
                self.firmware.advance(end_s)
                self.firmware.host_connected()
            self.carry()

    def carry(self):
        while data := self.firmware.pending():
            self.firmware.written(len(data))
            self.events += self.decoder.feed(data, self.firmware.now_s)

    @property
    def blocks(self):
        return [event for event in self.events if isinstance(event, Block)]

    @property
    def gaps(self):
        return [event for event in self.events if isinstance(event, Gap)]

    def missing_by_index(self):
        """Return every index between the first and the last sample that did not arrive."""
        seen = np.concatenate([b.index + np.arange(len(b)) for b in self.blocks])
        return set(range(seen[0], seen[-1] + 1)) - set(seen.tolist())

    def missing_by_ledger(self):
        last = self.blocks[-1].index + len(self.blocks[-1])
        lost = {
            index
            for loss in self.ledger.losses
            for index in range(loss.first, loss.first + loss.count)
        }
        return {index for index in lost if self.blocks[0].index <= index < last}


def test_without_faults_every_sample_arrives_as_it_was_made():
    bench = Bench()
    bench.run(5.0)
    counts = np.concatenate([block.counts for block in bench.blocks])
    assert np.array_equal(counts, Simulator(rate=1660.0, seed=3).read(len(counts)).counts)
    assert len(counts) == bench.ledger.produced == bench.ledger.sent > 8000
    assert not bench.gaps
    assert not bench.ledger.losses


@pytest.mark.parametrize(
    "faults",
    [
        ("bit_flip:rate=1e-4",),
        ("byte_loss:rate=1e-4",),
        ("byte_loss:rate=2e-5,length=700",),
        ("byte_repeat:rate=1e-4",),
        ("garbage:rate=1e-4",),
        ("garbage:rate=1e-5,length=1000",),
        ("stall:at=2,seconds=6",),
        ("stall:rate=0.2,seconds=4",),
        ("unplug:at=3,seconds=2",),
        ("bit_flip:at=3.3", "garbage:at=4.4", "byte_loss:at=5.5"),
        ("bit_flip:rate=2e-4", "byte_loss:rate=2e-4", "garbage:rate=2e-4", "stall:at=2,seconds=6"),
    ],
    ids=" ".join,
)
def test_what_was_destroyed_is_exactly_what_is_reported_lost(faults):
    bench = Bench(*faults)
    bench.run(12.0)
    missing = bench.missing_by_index()
    assert missing == bench.missing_by_ledger()
    assert missing
    assert bench.decoder.stats.lost_samples == len(missing)
    assert sum(gap.lost for gap in bench.gaps) == len(missing)


def test_a_fault_at_a_given_time_hits_samples_though_a_status_is_due_then():
    bench = Bench("bit_flip:at=3")
    bench.run(5.0)
    assert bench.ledger.lost["bit_flip"] == 16


def test_what_arrives_through_faults_is_what_was_made():
    bench = Bench("bit_flip:rate=2e-4", "byte_loss:rate=1e-4,length=300", "garbage:rate=1e-4")
    bench.run(10.0)
    made = Simulator(rate=1660.0, seed=3).read(bench.ledger.produced).counts
    for block in bench.blocks:
        assert np.array_equal(block.counts, made[block.index : block.index + len(block)])


def test_index_gaps_of_the_device_are_its_drop_count():
    """A host that does not read: the ring fills, then samples are dropped and counted."""
    bench = Bench(ring_bytes=4096)
    bench.run(1.0)
    bench.firmware.advance(8.0)  # nobody carries
    bench.run(2.0)
    device = sum(gap.lost for gap in bench.gaps if gap.reason == "device")
    assert device == bench.ledger.dropped == bench.ledger.lost["ring full"] > 10_000
    statuses = [event.fields for event in bench.events if getattr(event, "kind", "") == "status"]
    assert statuses[-1]["dropped"] == device


def test_samples_that_wait_are_neither_sent_nor_lost():
    bench = Bench(ring_bytes=4096)
    bench.firmware.advance(5.0)
    ledger = bench.ledger
    waiting = ledger.produced - ledger.sent - ledger.dropped
    assert 0 < waiting * 14 < 2 * 4096
    bench.carry()
    assert ledger.produced == ledger.sent + ledger.dropped


def test_bytes_that_the_host_did_not_read_are_told_in_samples():
    """At a hang-up with 500 bytes unread, the frames of which a byte is missing are lost."""
    bench = Bench()
    bench.run(1.0)
    firmware, sent = bench.firmware, bytearray()
    firmware.advance(1.9)  # no status is among the last bytes
    while data := firmware.pending():
        sent += data
        firmware.written(len(data))
    bench.events += bench.decoder.feed(bytes(sent[:-500]), 1.9)
    firmware.host_disconnected(500)
    bench.events += bench.decoder.interrupt("disconnected")
    firmware.host_connected()
    bench.run(1.0)
    assert bench.ledger.lost["hang-up"] == 48  # three frames of 224 bytes hold 500
    assert bench.missing_by_index() == bench.missing_by_ledger()
    assert [gap.reason for gap in bench.gaps] == ["disconnected"]


def test_without_a_host_samples_are_dropped_and_the_index_goes_on():
    bench = Bench()
    bench.run(1.0)
    bench.firmware.host_disconnected(0)
    bench.events += bench.decoder.interrupt("disconnected")
    bench.firmware.advance(3.0)
    bench.firmware.host_connected()
    bench.run(1.0)
    assert bench.ledger.lost["no host"] == pytest.approx(2 * 1660, rel=0.06)
    assert bench.missing_by_index() == bench.missing_by_ledger()


def test_reset_begins_a_new_epoch_that_counts_from_zero():
    bench = Bench("reset:at=3")
    epoch = bench.firmware.epoch
    bench.run(5.0)
    assert bench.firmware.epoch == (epoch + 1) & 0xFFFF
    restart = [block.index for block in bench.blocks].index(0, 1)
    assert restart > 1
    assert [gap.reason for gap in bench.gaps] == ["restarted"]
    assert bench.blocks[restart].ticks.device_s[0] < 0.1  # its clock began anew as well


def test_stall_is_silent_and_goes_on_measuring():
    bench = Bench("stall:at=2,seconds=3", rate=104.0)
    bench.run(2.0)
    before = len(bench.blocks)
    bench.run(2.9)
    assert len(bench.blocks) == before
    bench.run(1.0)
    assert not bench.gaps  # three seconds at 104 Hz fit into the ring
    assert bench.decoder.stats.samples == bench.ledger.produced


def test_status_tells_the_counts_of_the_epoch():
    bench = Bench("reset:at=2.5")
    bench.run(4.6)
    statuses = [event.fields for event in bench.events if getattr(event, "kind", "") == "status"]
    produced = [fields["produced"] for fields in statuses]
    assert len(statuses) == 4  # at 1 and 2 s, then 1 and 2 s after the reset
    assert produced[2] == pytest.approx(produced[0], abs=16)
    assert produced[3] == pytest.approx(2 * produced[0], abs=32)


@pytest.mark.parametrize("kind", [k for k, v in FAULT_KINDS.items() if v.where == "bytes"])
def test_a_fault_never_touches_the_ends_of_a_frame(kind):
    """The last byte ends the frame: were it hit, the next frame would go down unbooked."""
    noise = LineNoise([parse_fault(f"{kind}:rate=0.1")], np.random.default_rng(1))
    for _ in range(500):
        frame = bytes([1, 2, 3, 4, 5, 0])
        data = noise.damage(frame, 0.0).data
        if kind != "byte_loss":
            assert data[0] == 1
            assert data[-1] == 0


def test_two_flips_of_the_same_bit_are_no_damage():
    class SameBit:
        exponential = staticmethod(lambda mean: 1.0)
        integers = staticmethod(lambda *bounds: 1)

    noise = LineNoise([parse_fault("bit_flip:rate=0.1")], SameBit())
    even = noise.damage(bytes(10), 0.0)
    assert (even.data, even.cause, len(even.kinds)) == (bytes(10), "", 10)
    odd = noise.damage(bytes(11), 0.0)
    assert odd.cause == "bit_flip"


def test_a_long_loss_takes_a_byte_of_the_frame_whose_neighbour_it_ends():
    """A loss up to the very end of one frame would join it to the next: both are destroyed."""
    frame = bytes(range(1, 40)) + b"\0"
    for length in range(1, 130):
        noise = LineNoise([parse_fault(f"byte_loss:at=0,length={length}")],
                          np.random.default_rng(length))  # fmt: skip
        damages = [noise.damage(frame, 0.0) for _ in range(8)]
        for damage, following in pairwise(damages):
            if damage.cause and not damage.data.endswith(b"\0"):
                assert following.cause == "byte_loss"
        assert not damages[-1].cause
        hit = sum(len(frame) - len(damage.data) for damage in damages)
        assert length <= hit <= length + 4


def test_occurrences_have_their_mean_rate():
    occurrences = Occurrences(0.5, np.random.default_rng(1))
    counts = [occurrences.until(coordinate) for coordinate in range(1, 10_001)]
    assert sum(counts) == pytest.approx(5000, abs=5 * 5000**0.5)
    assert np.var(counts) == pytest.approx(0.5, rel=0.1)


def test_ledger_joins_neighbours_of_one_cause():
    ledger = Ledger()
    ledger.lose(1, 10, 5, "no host")
    ledger.lose(1, 15, 5, "no host")
    ledger.lose(1, 20, 5, "bit_flip")
    ledger.lose(2, 25, 5, "bit_flip")
    assert ledger.losses == [
        Loss(1, 10, 10, "no host"), Loss(1, 20, 5, "bit_flip"), Loss(2, 25, 5, "bit_flip"),
    ]  # fmt: skip
    assert (ledger.dropped, ledger.damaged) == (10, 10)
    assert ledger.missing(1, 12, 22) == 10
    assert ledger.missing(2, 0, 27) == 2
    assert ledger.missing(1, 0, 9) == ledger.missing(1, 30, 40) == 0


def test_faults_in_words():
    assert parse_fault("stall:at=3,seconds=2").seconds == 2.0
    assert parse_fault("garbage:rate=1e-6,length=64").length == 64
    assert parse_fault("bit_flip:rate=1e-6").at is None
    assert len(fault_help().splitlines()) == len(FAULT_KINDS) == 7


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("fire:at=1", r"unknown fault 'fire'; choose one of bit_flip, .*reset"),
        ("stall:seconds=2", r"say how often or when, e.g. stall:at=10"),
        ("reset:at=1,seconds=2", r"no parameter 'seconds'; it takes rate, at"),
        ("bit_flip:rate=0.5", r"at most 0.1, got 0.5"),
        ("bit_flip:rate=often", r"rate must be a number"),
    ],
)
def test_wrong_faults_are_answered_in_one_line(text, says):
    with pytest.raises(UsageError, match=says):
        parse_fault(text)
