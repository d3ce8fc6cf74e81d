"""Rows of text without values, where no time tells that samples are missing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from allanscope.samples import Block, Event, Gap, Notice
from allanscope.wire.base import WireSettings
from allanscope.wire.text import decoder as decoding
from allanscope.wire.text.decoder import TextDecoder

HEADER = "gx[dps],gy[dps],gz[dps]"


def lines(count: int, blank: dict[int, str]) -> list[str]:
    rng = np.random.default_rng(5)
    rows = [",".join(f"{value:.3f}" for value in row) for row in rng.normal(size=(count, 3))]
    return [blank.get(i, row) for i, row in enumerate(rows)]


def events(
    rows: list[str], monkeypatch: pytest.MonkeyPatch, together: int, header: str = HEADER
) -> tuple[list[Event], TextDecoder]:
    monkeypatch.setattr(decoding, "_WORTH_A_CALL", together)
    decoder = TextDecoder(WireSettings(rate_hz=100.0))
    text = "\n".join([header, *rows, ""]).encode()
    half = text.index(b"\n", len(text) // 2) + 1  # between two rows
    found = decoder.feed(text[:half], math.nan) + decoder.feed(text[half:], math.nan)
    return [*found, *decoder.finish()], decoder


@pytest.mark.parametrize("together", [1, 1 << 40], ids=["lines", "tables"])
@pytest.mark.parametrize("cells", ["nan,nan,nan", ",,", "0.5,NaN,1.5", "0.5,,1.5"])
def test_a_row_without_its_values_is_a_lost_sample(
    cells: str, together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost = {40: cells, 150: cells, 151: cells, 152: cells}
    found, decoder = events(lines(400, lost), monkeypatch, together)
    assert [gap.lost for gap in found if isinstance(gap, Gap)] == [1, 3]
    blocks = [event for event in found if isinstance(event, Block)]
    places = np.concatenate([b.index + np.arange(len(b.counts)) for b in blocks])
    assert places.tolist() == [i for i in range(400) if i not in lost]
    assert decoder.stats.lost_samples == 4
    said = [event.text for event in found if isinstance(event, Notice)]
    assert said == [
        "sample 41: the row before it has blank cells, NaN or zeros only: a lost sample",
        "sample 153: the 3 rows before it have blank cells, NaN or zeros only: lost samples",
    ]


@pytest.mark.parametrize("together", [1, 1 << 40], ids=["lines", "tables"])
def test_blank_rows_where_a_read_ends_are_counted(
    together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The text comes in two reads; blank rows end the first and begin the second."""
    blank = dict.fromkeys(range(180, 225), "0.500,NaN,1.500")
    found, _ = events(lines(400, blank), monkeypatch, together)
    assert [gap.lost for gap in found if isinstance(gap, Gap)] == [45]


@pytest.mark.parametrize("together", [1, 1 << 40], ids=["lines", "tables"])
@pytest.mark.parametrize("every", [2, 8])
def test_rows_of_a_slower_sensor_between_others_are_no_losses(
    every: int, together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A device prints several rates in one table: most rows have no value of this sensor."""
    rows = [row if i % every == 0 else ",,7.0" for i, row in enumerate(lines(800, {}))]
    found, decoder = events(rows, monkeypatch, together, header="gx[dps],gy[dps],pressure")
    told = [event for event in found if isinstance(event, Gap | Notice)]
    assert [getattr(event, "text", "") for event in told] == ["columns left out: pressure"]
    assert decoder.stats.samples == 800 // every


def test_times_tell_what_is_lost_where_there_are_any(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [f"{i / 100:.2f},{row}" for i, row in enumerate(lines(400, {40: "nan,nan,nan"}))]
    found, _ = events(rows, monkeypatch, 1 << 40, header=f"t[s],{HEADER}")
    assert [gap.lost for gap in found if isinstance(gap, Gap)] == [1]


GRAVITY = "gx[dps],gy[dps],gz[dps],ax[g],ay[g],az[g]"


def rows_of_six(count: int, zeros: set[int], level: float) -> list[str]:
    rng = np.random.default_rng(6)
    rows = np.round(rng.normal(size=(count, 6)) * [0.1, 0.1, 0.1, 0.01, 0.01, 0.01], 3)
    rows[:, 5] += level
    return [",".join(["0"] * 6 if i in zeros else map(str, rows[i])) for i in range(count)]


@pytest.mark.parametrize("together", [1, 1 << 40], ids=["lines", "tables"])
def test_a_row_of_zeros_is_lost_where_the_sensor_weighs_something(
    together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A logger that had nothing wrote zeros: a comb of lines, and outliers of 1 g."""
    zeros = {10, 40, 200, 201}
    found, decoder = events(rows_of_six(400, zeros, 1.0), monkeypatch, together, header=GRAVITY)
    assert [gap.lost for gap in found if isinstance(gap, Gap)] == [1, 1, 2]
    assert (decoder.stats.samples, decoder.stats.lost_samples) == (396, 4)


def test_a_row_of_zeros_is_a_sample_where_gravity_was_taken_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, decoder = events(rows_of_six(400, {40}, 0.0), monkeypatch, 1 << 40, header=GRAVITY)
    assert not [event for event in found if isinstance(event, Gap)]
    assert decoder.stats.samples == 400
