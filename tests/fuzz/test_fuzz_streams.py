"""Whatever comes over a wire or lies in a file: events, or the one kind of error; nothing else."""

from __future__ import annotations

import math
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from allanscope.analysis import Analyser, summarise
from allanscope.errors import AllanscopeError
from allanscope.pipeline import Decoding, DeviceSettings, analyse_input
from allanscope.recording import Chunk, Recording, write_recording
from allanscope.samples import Block, Event, StreamInfo
from allanscope.wire import WireSettings, format_named, sniff
from support.damaged_streams import FORMATS, damaged, real_stream

SLOW_S = 20.0
"""CPU time that 64 kB may take on any machine: only what hangs takes longer."""


def check(events: list[Event]) -> Analyser:
    """Hold events to the contract between rooms, then take them."""
    analyser, info = Analyser(), None
    for event in events:
        if isinstance(event, StreamInfo):
            info = event
            assert all(math.isfinite(scale) and scale > 0.0 for scale in info.scale)
            assert math.isfinite(info.nominal_hz)
            assert info.nominal_hz >= 0.0
        if isinstance(event, Block):
            assert info is not None
            assert event.counts.shape == (len(event), len(info.axes))
            assert np.isfinite(event.counts).all()
            assert (np.diff(event.ticks.offset) >= 0).all()
        if hasattr(event, "text"):
            assert event.text.isprintable()
        analyser.feed(event)
    return analyser


def decoded(name: str, pieces: list[bytes]) -> list[Event]:
    decoder = format_named(name).decoder(WireSettings())
    events = []
    for number, piece in enumerate(pieces):
        events += decoder.feed(piece, 1.0 + 0.01 * number)
    return events + decoder.interrupt("disconnected") + decoder.finish()


@pytest.mark.parametrize("name", FORMATS)
@settings(max_examples=30, deadline=None)
@given(pieces=st.lists(st.binary(max_size=300), max_size=5))
def test_any_bytes_in_any_decoder(name: str, pieces: list[bytes]) -> None:
    check(decoded(name, pieces))


@pytest.mark.parametrize("name", FORMATS)
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32), hits=st.integers(1, 40), cut=st.integers(1, 5000))
def test_any_damage_to_a_real_stream(name: str, seed: int, hits: int, cut: int) -> None:
    data = damaged(real_stream(name), seed, hits)
    check(decoded(name, [data[:cut], data[cut:]]))


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=2000))
def test_sniffing_any_bytes(sample: bytes) -> None:
    found = sniff(sample)
    assert all(0.0 <= score <= 1.0 for score in found.scores.values())
    assert found.excerpt.isprintable()


CELL = st.one_of(
    st.floats(width=32).map(repr),
    st.integers(-(10**20), 10**20).map(str),
    st.sampled_from(["", "nan", "-inf", "1e999", "0x10", "1,5", "²", "\x1b[2J", "NULL"]),
    st.sampled_from(["1e308", "-1e199", "1e10", "1e-160", "1e-320", "-0"]),
)
TABLE = st.lists(st.lists(CELL, min_size=1, max_size=8).map(",".join), min_size=3, max_size=30)
HEADER = st.sampled_from(
    ["", "t[s],gx[dps],gy[dps]", "gx[lsb],gx[lsb]", "ax[mg],temp[degC]", "t[ms],gz[rad/s],", "a,b"]
)


@settings(max_examples=30, deadline=None)
@given(header=HEADER, rows=TABLE)
def test_any_table_as_a_file(
    tmp_path_factory: pytest.TempPathFactory, header: str, rows: list[str]
) -> None:
    path = tmp_path_factory.getbasetemp() / "table.csv"
    path.write_text("\n".join([header, *rows]), encoding="utf-8")
    device = DeviceSettings(rate_hz=100.0, part="LSM6DSM", gyro_fs=250.0, accel_fs=2.0)
    error: AllanscopeError | None = None
    try:
        samples = analyse_input(path, device, quiet=True).to_dict()["samples"]
    except AllanscopeError as raised:
        error, samples = raised, 0
    assert samples > 0 if error is None else str(error).isprintable()


@pytest.mark.parametrize("name", FORMATS)
def test_sums_of_a_damaged_stream_can_be_summarised(name: str) -> None:
    analyser = check(decoded(name, [damaged(real_stream(name) * 3, 11, 20)]))
    result = summarise(analyser, Decoding(WireSettings()).stats, "live", {})
    assert result.samples > 0


@pytest.mark.parametrize("name", ["native", "text"])
def test_damaged_streams_through_a_recording_and_the_whole_analysis(
    name: str, tmp_path: Path
) -> None:
    data = damaged(real_stream(name) * 6, 7, 60)
    chunks = [Chunk(1 + n * 10_000_000, data[n * 97 : n * 97 + 97]) for n in range(len(data) // 97)]
    path = write_recording(tmp_path / "a.mcap", chunks, {"rate_hz": "nonsense", "part": "\x1b[2J"})
    assert Recording(path).damage == []
    with pytest.raises(AllanscopeError, match="damaged"):
        analyse_input(path, DeviceSettings(), quiet=True)
    path = write_recording(tmp_path / "b.mcap", chunks, {})
    assert analyse_input(path, DeviceSettings(), quiet=True).samples > 50


ENDLESS = {
    "zeros": b"\0",
    "flags": b"\xf0",
    "escapes": b"\xf1",
    "a line without end": b"7",
    "cells without end": b"1,",
    "blank lines": b"\n",
    "blanks": b" ",
    "blanks between words": b"a" + b" " * 4000 + b"b\n",
    "short lines": b"1,2,3\n",
    "escape sequences": b"\x1b[",
    "open strings": b"\x1b]",
    "longest frames": b"\xff" * 254,
    "headers": b"t,gx,gy,gz\n",
}


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("what", ENDLESS)
def test_much_of_the_same_takes_bounded_time_and_memory(name: str, what: str) -> None:
    unit = ENDLESS[what]
    piece = (unit * (4096 // len(unit) + 1))[:4096]
    decoder = format_named(name).decoder(WireSettings())
    for _ in range(8):
        decoder.feed(piece, 1.0)
    tracemalloc.start()
    began = time.process_time()
    for number in range(16):
        decoder.feed(piece, 1.0 + number)
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert time.process_time() - began < SLOW_S
    assert kept < 1 << 15, "what was fed is not kept"
