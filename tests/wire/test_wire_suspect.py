"""Rows that a damaged line altered and no check caught are left out; what a sensor does is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from allanscope.samples import Block, Gap
from allanscope.simulator import Simulator, Truth, parse_effect
from allanscope.wire import WireSettings, format_named, formats
from allanscope.wire.plausibility import Plausibility
from support.asked import said_when_asked

UNCHECKED = ("text", "datalog", "datalog11", "sdatalog", "tmsg", "tmsg-sensortile")
EFFECTS = (
    "outliers:count=20,axis=gx",
    "outliers:count=5,size=3,axis=ay",
    "step:size=0.5,axis=gy,time=7",
    "excursion:size=2,duration=0.5,time=3,axis=gz",
)


def stream(wire, samples=1600, effects=(), seed=7):
    """Return what a device of a format sends, in pieces of a few samples."""
    encoder = format_named(wire).encoder()
    truth = replace(Truth.typical("LSM6DSM", seed), effects=tuple(map(parse_effect, effects)))
    device = Simulator(rate=104.0, seed=seed, gyro_fs=250.0, truth=truth)
    per = max(encoder.samples_per_frame(104.0), 1)
    pieces = [encoder.describe(device.info) + said_when_asked(encoder, wire)]
    return pieces + [encoder.encode(device.read(per)) for _ in range(samples // per)]


def flipped(pieces, rate=1e-3, seed=1):
    """Invert single bits of all but the first pieces, which decide on what rows mean."""
    rng = np.random.default_rng(seed)
    out = []
    for number, piece in enumerate(pieces):
        data = bytearray(piece)
        if number > 60:
            for at in np.flatnonzero(rng.random(len(data)) < rate):
                data[at] ^= 1 << int(rng.integers(8))
        out.append(bytes(data))
    return out


def decoded(wire, pieces):
    """Return events and counters."""
    decoder = format_named(wire).decoder(WireSettings())
    events = [event for piece in pieces for event in decoder.feed(piece, 0.5)]
    return events + decoder.finish(), decoder.stats


def rows_of(events):
    return np.concatenate([event.counts for event in events if isinstance(event, Block)])


def table(rows, bad_line=None):
    """Return rows as CSV, one line damaged beyond recognition if asked."""
    lines = ["gx[dps],gy[dps],gz[dps]", *(",".join(f"{v:.4f}" for v in row) for row in rows)]
    if bad_line is not None:
        lines[bad_line] = "0.01,0.0p2,0.03"
    return [("\n".join(lines) + "\n").encode()]


@pytest.mark.parametrize("wire", ["text", "datalog"])
def test_values_far_off_that_a_damaged_line_made_are_left_out_and_counted(wire):
    pieces = stream(wire, 4000)
    sent = rows_of(decoded(wire, pieces)[0])
    events, stats = decoded(wire, flipped(pieces))
    got = rows_of(events)
    assert stats.suspect > 5
    assert stats.samples == len(got)
    # What passes is within what noise could be: the largest error is far below that of a digit.
    low, high = sent.min(axis=0), sent.max(axis=0)
    width = np.maximum(high - low, 2.0 if np.issubdtype(got.dtype, np.integer) else 0.0)
    beyond = np.maximum(low - got, got - high)
    assert (beyond > 4.0 * width).any(axis=1).sum() <= stats.suspect // 4


@pytest.mark.parametrize("wire", formats())
def test_whatever_a_sensor_does_on_a_sound_line_nothing_is_suspect(wire):
    events, stats = decoded(wire, stream(wire, effects=EFFECTS))
    assert stats.suspect == 0
    assert stats.lost_samples == 0
    assert len(rows_of(events)) >= 1590


@pytest.mark.parametrize("wire", UNCHECKED)
def test_what_is_suspect_does_not_depend_on_how_bytes_came(wire):
    data = b"".join(flipped(stream(wire), 3e-3))
    once, stats = decoded(wire, [data])
    for size in (60, 1000):
        parts, again = decoded(wire, [data[i : i + size] for i in range(0, len(data), size)])
        assert again == stats
        np.testing.assert_array_equal(rows_of(parts), rows_of(once))
        assert [e for e in parts if isinstance(e, Gap)] == [e for e in once if isinstance(e, Gap)]


def noise(rows=400, seed=4):
    return np.random.default_rng(seed).normal(0.0, 0.04, (rows, 3))


@pytest.mark.parametrize(("bad_line", "suspect"), [(None, 0), (150, 1)])
def test_a_value_far_off_is_suspect_only_where_the_line_damages_rows(bad_line, suspect):
    rows = noise()
    rows[200, 1] = 4.0
    events, stats = decoded("text", table(rows, bad_line))
    assert stats.suspect == suspect
    assert (np.abs(rows_of(events)) > 1.0).any() == (not suspect)


def shock_of_two_axes(rows):
    rows[200, :2] = 4.0, 2.0


def shock_that_rings(rows):
    rows[200:203, 1] = 4.0, -2.0, 1.0


def step(rows):
    rows[200:, 1] += 4.0


def saturation(rows):
    rows[200:260, 1] = 250.0


def outliers_of_noise(rows):
    rows[200:400:20, 1] = 0.36  # nine standard deviations


@pytest.mark.parametrize(
    "event", [shock_of_two_axes, shock_that_rings, step, saturation, outliers_of_noise]
)
def test_what_a_sensor_may_do_is_believed_even_on_a_damaged_line(event):
    rows = noise()
    event(rows)
    events, stats = decoded("text", table(rows, 150))
    assert stats.suspect == 0
    assert len(rows_of(events)) == len(rows) - 1


def test_damage_is_forgotten_after_ten_thousand_sound_rows():
    rows = noise(10_400)
    rows[10_300, 1] = 4.0
    assert decoded("text", table(rows, 150))[1].suspect == 0
    rows[10_100, 1] = 4.0
    assert decoded("text", table(rows, 150))[1].suspect == 1


def test_real_axes_that_never_change_judge_nothing():
    rows = np.zeros((200, 2))
    rows[100, 0] = 5.0
    follower = Plausibility()
    assert not follower.isolated(rows).any()
