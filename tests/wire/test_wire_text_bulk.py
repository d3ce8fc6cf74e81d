"""Rows that are read together are those that are read one by one, to the last bit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from allanscope.samples import Block, Event
from allanscope.wire import WireSettings
from allanscope.wire.continuity import Continuity
from allanscope.wire.text import decoder as decoding
from allanscope.wire.text.columns import cells_of, columns_of
from allanscope.wire.text.decoder import TextDecoder
from allanscope.wire.text.table import Table

NAMES = "t[s],gx[dps],gy[dps],gz[dps],ax[g],ay[g],az[g],temperature[degC]"


def written(value: float, form: int) -> str:
    return (repr(value), f"{value:.6f}", f"{value:.9g}", f"{value:+.3e}", f" {value:.17g} ")[form]


def table(seed: int, rows: int = 300) -> list[str]:
    rng = np.random.default_rng(seed)
    form = int(rng.integers(0, 5))
    values = np.cumsum(rng.normal(size=(rows, 7)), axis=0) * 0.01 + [0, 0, 0, 0, 0, 1, 25]
    return [NAMES] + [
        ",".join([f"{i / 104:.9f}", *(written(value, form) for value in row)])
        for i, row in enumerate(values.tolist())
    ]


ODD = (
    "",
    "\r",
    "# a comment",
    NAMES,
    "1,2,3",
    "0.5,1,2,3,4,5,6,7,8",
    "0.5,1,2,3,4,5,6,7,",
    "0.5,,,,,,,",
    "0.5,1,,3,4,5,6,",
    "0.5,1, ,3,4,5,6,20",
    '0.5,"1",2,3,4,5,6,20',
    "0.5,nan,inf,-inf,1_0,5,6,20",
    "0.5,1;2,3,4,5,6,20",
    "4e12,1,2,3,4,5,6,20",
    "\x1b[31m1.5,1,2,3,4,5,6,20",
    "12:30:01.5,1,2,3,4,5,6,20",
    "1.5,1,2,3,4\r5,6,20",
    "1.5," + "1" * 5000 + ",2,3,4,5,6,20",
    "1.5,1e400,1e-400,1e23,123456789012345678901,0x10,6,20",
    "é,1,2,3,4,5,6,20",
)


def column(seed: int, rows: int = 300) -> list[str]:
    """Return a table of one column."""
    rng = np.random.default_rng(seed)
    form = int(rng.integers(0, 5))
    return ["gx[dps]", *(written(value, form) for value in rng.normal(size=rows).tolist())]


ODD_IN_COLUMN = (
    *(
        "",
        "\r",
        " ",
        "\t",
        " 1.5 ",
        "\t1.5",
        "1.5\t",
        "1,5",
        "1.5,",
        "1.5;",
        "1.5,2",
        "1 2",
        "1.5 ,",
    ),
    *("nan", "-inf", "1_0", "1e", "1e400", "0x10", '"1.5"', "# a comment", "gx[dps]", "gy[dps]"),
    *("12:30:01.5", "1.5\r2", "1" * 5000, "\x1b[31m1.5", "é", "1.5\0", "0.5,1,2"),
)


def plain(events: Iterable[Event]) -> list[Any]:
    said: list[Any] = []
    for event in events:
        if isinstance(event, Block):
            ticks = event.ticks
            arrays = (event.counts, ticks.offset, ticks.device_s, ticks.host_s, ticks.temperature_c)
            said.append((event.index, *(np.asarray(array).tobytes() for array in arrays)))
        else:
            said.append(event)
    return said


def decoded(pieces: list[bytes], together: int, host_s: float) -> tuple[Any, ...]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(decoding, "_WORTH_A_CALL", together)
        decoder = TextDecoder(WireSettings())
        said = []
        for number, piece in enumerate(pieces):
            if number == 3:
                said += plain(decoder.interrupt("unplugged"))
            said += plain(decoder.feed(piece, host_s + number))
        said += plain(decoder.finish())
    return said, decoder.stats, decoder._lines.number


@settings(max_examples=60, deadline=None)
@given(
    *(st.integers(0, 2**32 - 1), st.integers(0, 12), st.booleans()),
    st.sampled_from([(table, ODD), (column, ODD_IN_COLUMN)]),
)
@example(1, 0, False, (table, ODD))
@example(1, 0, False, (column, ODD_IN_COLUMN))
def test_events_and_counters_are_those_of_single_lines(
    seed: int, odd: int, live: bool, kind: tuple[Callable[[int], list[str]], tuple[str, ...]]
) -> None:
    rng = np.random.default_rng(seed)
    lines = kind[0](seed)
    for _ in range(odd):
        lines.insert(int(rng.integers(1, len(lines))), kind[1][rng.integers(0, len(kind[1]))])
    end = ("\n", "\r\n")[seed % 2]
    data = bytearray((end.join(lines) + end * (seed % 3 > 0)).encode())
    for _ in range(odd // 4):
        data[rng.integers(0, len(data))] = rng.integers(0, 256)
    cuts = sorted(rng.integers(0, len(data), seed % 6).tolist())
    pieces = [bytes(data[a:b]) for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]
    host_s = 5.0 if live else math.nan
    assert decoded(pieces, 1, host_s) == decoded(pieces, 1 << 40, host_s)


def losing(seed: int) -> bytes:
    """Return a table with lost rows, late, coarse or repeated times, and altered cells."""
    rng = np.random.default_rng(seed)
    n, rate = int(rng.integers(200, 2000)), float(rng.choice([12.5, 104.0, 416.0]))
    times = np.arange(n) / rate
    late = rng.uniform(0.0, 0.6 / rate, n)
    times = [times, times.round(2), times.round(3), times + late][rng.integers(0, 4)]
    if rng.random() < 0.2:
        times[n // 2 :] -= times[n // 3]
    kept = np.ones(n, bool)
    for at in rng.integers(30, n, rng.integers(0, 6)):
        kept[at : at + rng.choice([1, 2, 5, 40])] = False
    values = rng.normal(size=(n, 7)) * 0.01 + [0, 0, 0, 0, 0, 1, 25]
    lines = [
        ",".join([f"{time:.6f}", *(f"{value:.5f}" for value in row)])
        for time, row in zip(times[kept].tolist(), values[kept].tolist(), strict=True)
    ]
    for at in rng.integers(30, len(lines), rng.integers(0, 8)).tolist():
        cell = int(rng.integers(0, len(lines[at])))
        lines[at] = lines[at][:cell] + str(rng.choice([*"0159.,-x;"])) + lines[at][cell + 1 :]
    return "\n".join([NAMES, *lines, ""]).encode()


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), live=st.booleans())
@example(seed=5, live=False)
def test_rows_that_are_delivered_together_are_told_as_they_are_one_by_one(
    seed: int, live: bool
) -> None:
    data, rng = losing(seed), np.random.default_rng(seed)
    cuts = sorted(rng.integers(0, len(data), rng.choice([0, 1, 4, 20])).tolist())
    pieces = [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]
    host_s = 5.0 if live else math.nan
    together = decoded(pieces, 4096, host_s)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Continuity, "accept", lambda *_: 0)
        assert decoded(pieces, 4096, host_s) == together


def test_few_rows_are_looked_at_one_by_one() -> None:
    looked_at = []
    look = Continuity.missing
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Continuity, "missing", lambda *a: looked_at.append(a) or look(*a))
        decoder = TextDecoder(WireSettings())
        decoder.feed("\n".join([*table(1), ""]).encode(), math.nan)
    assert decoder.stats.samples == 300
    assert len(looked_at) < 5


@pytest.mark.parametrize("written_as", [table, column])
def test_most_rows_are_read_together(written_as: Callable[[int, int], list[str]]) -> None:
    data = "\n".join([*written_as(1, 3000), ""]).encode()
    decoder = TextDecoder(WireSettings())
    single = []
    read = Table.row
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Table, "row", lambda self, line: single.append(line) or read(self, line))
        decoder.feed(data, math.nan)
    assert decoder.stats.frames == 3000
    assert len(single) < 10


NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.floats(-1e3, 1e3).map(repr),
    st.from_regex(r"\A[+-]?[0-9]{0,25}\.?[0-9]{0,25}(e[+-]?[0-9]{1,4})?\Z"),
    st.tuples(st.integers(0, 2**64), st.integers(-30, 30)).map(lambda n: f"{n[0]}e{n[1]}"),
)


@settings(max_examples=500, deadline=None)
@given(number=NUMBERS)
@example("9007199254740993")
@example("9007199254740993e-1")
@example("18446744073709551615e-27")
@example("8.5e-05")
@example("200515781985469696e-18")  # rounded twice, by way of 64 bits, it is another
@example("0.00000000000000000000000000001")
@example("1e")
@example(".")
def test_a_number_is_the_one_that_python_reads_or_is_left_to_it(number: str) -> None:
    columns = columns_of(cells_of("gx[dps],gy[dps],gz[dps]"), "gyro")
    assert columns is not None
    rows = Table(columns)
    assert rows.row(b"1,2,3") is not None
    found = rows.plain_rows(memoryview(f"{number},2,3\n".encode()))
    if found is not None:
        expected = float(number) if number else math.nan
        assert found.values[0, :1].tobytes() == np.array([expected]).tobytes()


def test_the_numbers_of_ordinary_files_are_not_left_to_python() -> None:
    columns = columns_of(cells_of("gx[dps],gy[dps],gz[dps]"), "gyro")
    assert columns is not None
    rows = Table(columns)
    rows.row(b"1,2,3")
    values = np.random.default_rng(2).normal(size=(5000, 3))
    for form in (repr, "{:.3f}".format, "{:.9e}".format):
        text = "\n".join(",".join(map(form, row)) for row in values.tolist()) + "\n"
        found = rows.plain_rows(memoryview(text.encode()))
        assert found is not None
        assert len(found.values) > 100
        expected = [[float(cell) for cell in line.split(",")] for line in text.split()]
        assert found.values[:, :3].tolist() == expected[: len(found.values)]
