"""Every wire format through a real pty while the line fails: no loss goes unreported.

The simulated SensorTile keeps a ledger of every sample that it made and what became of it; what it
made can be made again from its seed. So each delivered run of samples is held against the truth:
where two runs are not neighbours there must be a gap between them, and a gap that has a number
must have the right one.
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field

import numpy as np
import pytest

from allanscope.analysis import Analyser
from allanscope.pipeline import Decoding
from allanscope.pipeline.session import Session
from allanscope.samples import Block, Gap, StreamInfo
from allanscope.simulator import Device, Ledger, Simulator
from allanscope.sources import SerialSource
from allanscope.wire import LinkStats, WireSettings

NOISE = ("bit_flip:rate={0}", "byte_loss:rate={0}", "byte_repeat:rate={0}", "garbage:rate={0}")
BYTES = {
    "native": 18, "tmsg": 40, "tmsg-sensortile": 60, "datalog": 130, "datalog11": 150, "text": 70,
}  # fmt: skip
"""About what a sample takes on the wire."""

FEWEST = 4
"""A run of fewer samples between holes of unknown length, one of them altered, lies nowhere."""

STALL = ("stall:at=1.5,seconds=1",)
UNPLUG = ("unplug:at=2,seconds=1",)


def noise(rate: float) -> tuple[str, ...]:
    """Return the four faults of bytes, each at a rate per byte."""
    return tuple(fault.format(rate) for fault in NOISE)


class Collector(Analyser):
    """Keeps the events as well."""

    def __init__(self) -> None:
        super().__init__()
        self.events = []

    def feed(self, event):
        self.events.append(event)
        super().feed(event)


@dataclass
class Run:
    """What a session heard of a device, and what the device knows of it."""

    events: list
    stats: LinkStats
    ledger: Ledger
    session: Session
    wire: str
    lost: int
    unknown: int
    made: np.ndarray = field(repr=False)

    def runs(self):
        """Return each hole (None before the first run) and the samples between it and the next."""
        info = next(event for event in self.events if isinstance(event, StreamInfo))
        found: list[tuple[Gap | None, list[np.ndarray]]] = [(None, [])]
        for event in self.events:
            if isinstance(event, Gap):
                found.append((event, []))
            elif isinstance(event, Block):
                found[-1][1].append(event.counts * np.asarray(info.scale))
        return [(gap, np.concatenate(values)) for gap, values in found if values]

    def sent(self):
        """Return what was sent, to the step that the format allows."""
        if self.wire in ("native", "text"):
            return self.made, 1e-8
        return np.trunc(np.round(self.made * 1e3, 9)) * 1e-3, 4e-3


def run(wire, rate, faults, seconds, speed=1.0, seed=5):
    """Read a device over a pty for some of its own time; nothing is told about its format."""
    sensor = {"rate": rate, "seed": seed, "gyro_fs": 250.0}
    device = Device(Simulator(**sensor), wire, faults, speed, seed=seed)
    collector = Collector()
    with device:
        source = SerialSource(device.url)
        decoding = Decoding(WireSettings(), "", source.write)
        session = Session(source, decoding, collector)
        reading = threading.Thread(target=session.run)
        reading.start()
        deadline = time.monotonic() + 60.0
        while device.ledger.produced < seconds * rate and time.monotonic() < deadline:
            time.sleep(0.02)
        session.stop()
        reading.join()
    again = Simulator(**sensor)
    made = again.read(device.ledger.produced).counts * np.asarray(again.info.scale)
    state = collector.state
    state.settle()
    return Run(
        collector.events, decoding.stats, device.ledger, session, decoding.wire,
        state.lost, state.unknown_losses, made,
    )  # fmt: skip


def place(values, sent, tolerance, earliest, damaged):
    """Return the index from `earliest` on from which most samples of a run were made."""
    values = values[:60]
    unlike = {}
    for first in range(earliest, len(sent) - len(values) + 1):
        off = (np.abs(values - sent[first : first + len(values)]) > tolerance).any(axis=1)
        if all(first + row in damaged for row in np.flatnonzero(off)):
            unlike[first] = int(off.sum())
            if not off.any():
                break
    assert unlike, f"a run of {len(values)} samples was never made after {earliest}"
    return min(unlike, key=unlike.get)


def hold_against_the_truth(ran: Run) -> list[tuple[int | None, int]]:
    """Walk through all that was delivered; return what each gap said and what was missing."""
    sent, tolerance = ran.sent()
    damaged = {i for loss in ran.ledger.losses for i in range(loss.first, loss.first + loss.count)}
    told: list[tuple[int | None, int]] = []
    stop, passed = 0, 0
    for gap, values in ran.runs():
        if gap is None:
            first = place(values, sent, tolerance, 0, damaged)
        elif gap.lost is None and len(values) < FEWEST:
            told.append((None, 0))
            passed += len(values)
            continue
        else:
            known = gap.lost is not None and not passed
            first = (
                stop + gap.lost if known else place(values, sent, tolerance, stop + passed, damaged)
            )
            told.append((gap.lost, gap.lost if gap.lost and passed else first - stop - passed))
            missing = set(range(stop, first))
            assert passed or missing <= damaged, "samples that nothing happened to were given up"
            passed = 0
        off = (np.abs(values - sent[first : first + len(values)]) > tolerance).any(axis=1)
        wrong = {first + int(row) for row in np.flatnonzero(off)}
        # An 8-bit sum passes one damaged message in 256, text any digit; a CRC-32 passes nothing.
        assert wrong <= (set() if ran.wire == "native" else damaged)
        stop = first + len(values)
    return told


@pytest.mark.parametrize(
    ("wire", "rate", "speed"),
    [
        ("native", 104.0, 16.0),
        ("native", 6660.0, 1.0),
        ("tmsg", 104.0, 16.0),
        ("tmsg", 6660.0, 1.0),
        ("tmsg-sensortile", 52.0, 32.0),
        ("datalog", 104.0, 16.0),
        ("datalog11", 50.0, 32.0),
        ("text", 104.0, 16.0),
        ("text", 6660.0, 1.0),
    ],
)
def test_on_a_noisy_line_what_was_lost_is_exactly_what_is_reported(wire, rate, speed):
    samples = 2500.0 if rate < 1000.0 else 10_000.0
    ran = run(wire, rate, noise(10.0 / (samples * BYTES[wire])), samples / rate, speed)
    assert ran.wire == wire
    told = hold_against_the_truth(ran)
    assert told
    assert all(lost == missing for lost, missing in told)
    assert (ran.lost, ran.unknown) == (sum(lost for lost, _ in told), 0)
    assert ran.ledger.lost.keys() >= {"bit_flip", "byte_loss", "byte_repeat", "garbage"}


@pytest.mark.parametrize("wire", ["tmsg-sensortile", "datalog11"])
def test_where_stamps_cannot_tell_every_hole_is_reported_as_unknown(wire):
    """Hundredths of a second at 104 Hz: the firmware's clock is coarser than its samples."""
    ran = run(wire, 104.0, noise(1e-4), 15.0, 16.0)
    told = hold_against_the_truth(ran)
    assert told
    assert {lost for lost, _ in told} == {None}
    assert (ran.lost, ran.unknown) == (0, len(told))


@pytest.mark.parametrize("wire", ["native", "tmsg", "text"])
def test_a_stall_that_fits_the_ring_loses_nothing(wire):
    ran = run(wire, 104.0, STALL, 4.0, 4.0)
    assert hold_against_the_truth(ran) == []
    assert ran.ledger.lost.keys() <= {"hang-up", "no host"}  # when the session ended


@pytest.mark.parametrize("wire", ["native", "tmsg"])
def test_an_unplugged_cable_is_one_gap_and_one_reconnection(wire):
    ran = run(wire, 104.0, UNPLUG, 5.0, 2.0)
    told = hold_against_the_truth(ran)
    assert ran.session.result("live").reconnects == 1
    assert len(told) == 1
    lost, missing = told[0]
    assert lost == (missing if wire == "native" else None)
    assert missing > 50
