"""What the link does, as the decoding and the sums are told of it."""

from __future__ import annotations

import numpy as np
import pytest

from allanscope.analysis import Analyser
from allanscope.analysis.analyser import MOST_CONFIGURATIONS, MOST_ERRORS
from allanscope.pipeline import Decoding
from allanscope.samples import Block, Event, Gap, Notice, StreamInfo, Ticks
from allanscope.simulator import Simulator
from allanscope.sources import Chunk
from allanscope.wire import WireSettings, format_named

SECOND = 1_000_000_000


def rows(first: int, count: int, header: str = "") -> bytes:
    """Return rows of text that have neither a number nor a time."""
    noise = np.random.default_rng(first).integers(-50, 50, (count, 3))
    return (header + "".join(f"{x},{y},{z}\n" for x, y, z in noise)).encode()


def gaps(events: list[Event]) -> list[Gap]:
    return [event for event in events if isinstance(event, Gap)]


def test_a_stall_of_rows_without_number_or_time_is_a_loss_that_nothing_tells() -> None:
    decoding = Decoding(WireSettings(rate_hz=104.0, part="LSM6DSM"), "text")
    events = decoding.feed(Chunk(SECOND, rows(0, 100, "gx[lsb],gy[lsb],gz[lsb]\n")))
    events += decoding.feed(Chunk(5 * SECOND, b"", "stalled"))
    assert gaps(events) == []
    events += decoding.feed(Chunk(6 * SECOND, rows(1, 100), "resumed"))
    assert gaps(events + decoding.finish()) == [Gap("stalled", None)]


def test_a_stall_of_numbered_samples_costs_what_the_numbers_say() -> None:
    encoder, sensor = format_named("native").encoder(), Simulator(rate=104.0)
    hello = encoder.describe(sensor.info)
    before, _, after = (encoder.encode(sensor.read(30)) for _ in range(3))
    told: list[bytes] = []
    decoding = Decoding(WireSettings(), "native", told.append)
    events = decoding.feed(Chunk(SECOND, hello + before))
    events += decoding.feed(Chunk(5 * SECOND, b"", "stalled"))
    events += decoding.feed(Chunk(6 * SECOND, after, "resumed"))
    assert [gap.lost for gap in gaps(events)] == [30]
    assert told, "a board that restarted in silence is told to start"
    texts = [event.text for event in events if isinstance(event, Notice)]
    assert texts == ["no data from the device", "data from the device again"]


def test_a_port_that_says_nothing_is_told_to_start_and_then_complained_about_once() -> None:
    told: list[bytes] = []
    decoding = Decoding(WireSettings(), write=told.append)
    events: list[Event] = []
    for tenth in range(100):
        events += decoding.feed(Chunk(SECOND + tenth * SECOND // 10))
    starts = sum(len(format_named(name).start(WireSettings())) for name in ("native", "tmsg"))
    assert len(told) >= starts
    (complaint,) = events
    assert isinstance(complaint, Notice)
    assert "check the port" in complaint.text


def info(scale: float) -> StreamInfo:
    return StreamInfo(("gz",), (scale,), 104.0)


def block(count: int) -> Block:
    return Block(0, np.zeros((count, 1), np.int16), Ticks.none())


def test_a_device_that_returns_to_its_first_configuration_goes_on_with_its_sums() -> None:
    analyser = Analyser()
    for scale, count in ((1.0, 100), (2.0, 10), (1.0, 50)):
        for event in (info(scale), Gap("restarted", None), block(count)):
            analyser.feed(event)
    assert [state.samples for state in analyser.configurations] == [10, 150]
    assert analyser.state is analyser.configurations[1]
    assert analyser.state.segments == 2


def test_a_device_that_tells_ever_new_scales_and_troubles_fills_no_memory() -> None:
    analyser = Analyser()
    analyser.feed(info(99.0))
    analyser.feed(block(1000))
    for number in range(3 * MOST_CONFIGURATIONS):
        analyser.feed(info(1.0 + number))
        analyser.feed(block(1))
        analyser.feed(Notice("error", f"trouble {number % (2 * MOST_ERRORS)}"))
    assert len(analyser.configurations) == MOST_CONFIGURATIONS
    assert max(state.samples for state in analyser.configurations) == 1000
    assert len(analyser.errors) <= MOST_ERRORS
    assert len(set(analyser.errors)) == len(analyser.errors)


@pytest.mark.parametrize("event", ["disconnected", "hole"])
def test_what_breaks_a_link_is_told_by_the_numbers_or_not_at_all(event: str) -> None:
    encoder, sensor = format_named("native").encoder(), Simulator(rate=104.0)
    decoding = Decoding(WireSettings(), "native")
    decoding.feed(Chunk(SECOND, encoder.describe(sensor.info) + encoder.encode(sensor.read(30))))
    sensor.read(7)
    decoding.feed(Chunk(2 * SECOND, b"", event))  # type: ignore[arg-type]
    found = gaps(decoding.feed(Chunk(3 * SECOND, encoder.encode(sensor.read(30)))))
    assert [(gap.reason, gap.lost) for gap in found] == [
        ("disconnected" if event == "disconnected" else "file", 7)
    ]


@pytest.mark.parametrize("lost", [0, 7])
def test_a_full_buffer_costs_no_more_than_the_numbers_say(lost: int) -> None:
    """Half a frame before it and half behind it are one, where nothing was thrown away."""
    encoder, sensor = format_named("native").encoder(), Simulator(rate=104.0)
    decoding = Decoding(WireSettings(), "native")
    first = encoder.describe(sensor.info) + encoder.encode(sensor.read(30))
    decoding.feed(Chunk(SECOND, first[:-20]))
    sensor.read(lost)
    rest = first[-20:] + encoder.encode(sensor.read(30))
    found = gaps(decoding.feed(Chunk(2 * SECOND, rest, "overrun")) + decoding.finish())
    assert [(gap.reason, gap.lost) for gap in found] == ([("device", 7)] if lost else [])


def test_a_full_buffer_ends_a_row_that_has_no_number() -> None:
    """Half a row and half of a later one would be a row, and nothing but its values would tell."""
    decoding = Decoding(WireSettings(), "text")
    rows = [b"%d,%d,2,3\n" % (10 * i, i) for i in range(90)]
    events = decoding.feed(Chunk(SECOND, b"".join(rows[:40]) + b"400,4"))
    rest = b"6,2,3\n" + b"".join(rows[60:])
    events += decoding.feed(Chunk(2 * SECOND, rest, "overrun")) + decoding.finish()
    assert [gap.reason for gap in gaps(events)] == ["link"]
    taken = 39 + 30  # the first row that a port gives may be half of one
    assert sum(len(event) for event in events if isinstance(event, Block)) == taken


def test_a_silent_board_is_started_after_debris_that_fits_no_format() -> None:
    """Noise of a plug comes before a board that waits; it is asked as if it had just come."""
    sent: list[bytes] = []
    decoding = Decoding(WireSettings(), write=sent.append)
    noise = bytes(range(1, 250, 7))
    decoding.feed(Chunk(SECOND, noise))
    for tenth in range(11, 40):
        decoding.feed(Chunk(tenth * SECOND // 10))
    assert sent == []  # slow text may go on
    (notice,) = decoding.feed(Chunk(4 * SECOND, b"", "stalled"))
    assert isinstance(notice, Notice)
    assert "fit no format" in notice.text
    for tenth in range(41, 60):
        decoding.feed(Chunk(tenth * SECOND // 10))
    assert len(sent) > 3
    encoder, sensor = format_named("native").encoder(), Simulator(rate=104.0)
    frames = encoder.describe(sensor.info) + encoder.encode(sensor.read(60))
    events = decoding.feed(Chunk(6 * SECOND, frames, "resumed")) + decoding.finish()
    assert decoding.wire == "native"
    assert sum(len(event) for event in events if isinstance(event, Block)) == 60
