"""Parts of a stream with holes, cut anywhere, against one pass; no scheduler takes part."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from allanscope.allan import AllanBank
from allanscope.allan.shard import ALIGNED
from allanscope.fleet.part_sums import PartSums, TailBuffer
from allanscope.samples import Block, Event, Gap, Ticks
from allanscope.spectrum import SpectrumBank

LENGTHS = (ALIGNED * 3 + 77, 40, ALIGNED * 33 + 5000, 1000, ALIGNED + 3, 2 * ALIGNED)
"""Samples between holes."""


@pytest.fixture(scope="module")
def stream() -> list[Event]:
    rng = np.random.default_rng(11)
    events: list[Event] = []
    for length in LENGTHS:
        counts = (rng.standard_normal((length, 1)) * 30 - 200).astype(np.int16)
        for part in np.array_split(counts, max(length // 30_000, 1)):
            events.append(Block(0, part, Ticks.none()))
        events.append(Gap("link", 3))
    return events[:-1]


def summed(events: list[Event]) -> tuple[AllanBank, SpectrumBank]:
    bank, spectrum = AllanBank(1.0, 1), SpectrumBank(1.0, 1)
    feed([bank, spectrum], events)
    return bank, spectrum


def feed(takers: list[Any], events: list[Event]) -> None:
    for event in events:
        for taker in takers:
            if isinstance(event, Block):
                taker.update(event.counts)
            else:
                taker.gap()


def in_parts(events: list[Event], bounds: list[int]) -> tuple[AllanBank, SpectrumBank]:
    tail = TailBuffer(1)
    partials = []
    for first, stop in zip([0, *bounds], [*bounds, len(events)], strict=True):
        partial = PartSums(tail.anchor, tail.taken, tail.recent())
        for event in events[first:stop]:
            partial.feed(event)
        partial.finish(last=stop == len(events))
        partials.append(partial)
        feed([tail], events[first:stop])
    assert tail.rows_of_half_segment() > 8192
    bank = AllanBank(1.0, 1, anchor=tail.anchor)
    spectrum = SpectrumBank(1.0, 1, anchor=tail.anchor)
    for partial in partials:
        partial.join_to(bank, spectrum)
    return bank, spectrum


@pytest.mark.parametrize("bounds", [[40, 90, 150], [5, 13, 14, 15, 16, 17, 161, 162, 163]])
def test_parts_cut_anywhere_are_one_pass(stream: list[Event], bounds: list[int]) -> None:
    whole, whole_spectrum = summed(stream)
    bank, spectrum = in_parts(stream, bounds)
    assert bank.samples == whole.samples == sum(LENGTHS)
    for kind in ("oadev", "ohdev", "totdev", "mtotdev", "theo1"):
        one, other = whole.deviation(kind), bank.deviation(kind)
        np.testing.assert_array_equal(other.terms, one.terms)
        np.testing.assert_allclose(other.deviation, one.deviation, rtol=1e-13)
    one_state, state = whole_spectrum.state(), spectrum.state()
    np.testing.assert_array_equal(state["count"], one_state["count"])
    np.testing.assert_allclose(state["power"], one_state["power"], rtol=1e-12)


def test_the_tail_keeps_a_halo_and_what_fills_no_batch(stream: list[Event]) -> None:
    tail = TailBuffer(1)
    block = stream[0]
    assert isinstance(block, Block)
    samples: NDArray[Any] = np.concatenate([block.counts] * 10)
    for start in range(0, len(samples), 7001):
        tail.update(samples[start : start + 7001])
    rest = len(samples) % ALIGNED
    np.testing.assert_array_equal(tail.recent(), samples[-ALIGNED - rest :])
    tail.gap()
    assert (tail.taken, len(tail.recent())) == (0, 0)
