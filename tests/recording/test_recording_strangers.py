"""MCAP files that another program wrote or that somebody made up: bounded, and said."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from allanscope.__main__ import main
from allanscope.recording import Recording
from allanscope.recording.records import MOST_MESSAGES
from allanscope.samples import AXES, Block, StreamInfo, Ticks
from allanscope.wire.native import NativeEncoder

SCALE = (8.75e-3,) * 3 + (0.061e-3,) * 3
INFO = StreamInfo(AXES, SCALE, 104.0, "LSM6DSM", "native", 1e-6, True, 7)


def reads() -> list[bytes]:
    """Return what a device says in twenty seconds, a read a frame."""
    encoder, rng = NativeEncoder(), np.random.default_rng(2)
    counts = rng.normal(0.0, 20.0, (2080, 6)).astype(np.int16)
    out = [encoder.describe(INFO)]
    for start in range(0, len(counts), 4):
        ticks = Ticks(
            np.array([0]), np.array([start / 104.0]), np.array([np.nan]), np.array([25.0])
        )
        out.append(encoder.encode(Block(start, counts[start : start + 4], ticks)))
    return out


def written(path: Path, *, late: int = -1, **options: object) -> Path:
    """Write it as another program does; read number `late` has a time beyond 2^63."""
    with path.open("wb") as file:
        writer = Writer(file, **options)  # type: ignore[arg-type]
        writer.start(profile="allanscope")
        channel = writer.register_channel("/serial/rx", "", 0)
        for number, data in enumerate(reads()):
            at = 1_000_000_000 + number * 38_461_538
            host_ns = (1 << 63) + at if number == late else at
            writer.add_message(channel, at, data, host_ns, number + 1)
        writer.finish()
    return path


def analysed(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, Path]:
    out = path.with_suffix(".json")
    status = main(["analyse", str(path), "--json", str(out)])
    said = capsys.readouterr()
    return status, said.err, out


def test_a_time_beyond_what_clocks_show_costs_its_chunk_and_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "a.mcap", late=300, chunk_size=4096)
    status, _, out = analysed(path, capsys)
    assert status == 0
    result = json.loads(out.read_text())
    assert 1500 < result["samples"] < 2080
    assert any("an impossible time" in remark for remark in result["remarks"])


def test_messages_outside_of_chunks_are_not_read_and_that_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "a.mcap", use_chunking=False)
    (damage,) = Recording(path).damage
    assert "521 messages outside of chunks, which are not read" in str(damage)
    status, said, _ = analysed(path, capsys)
    assert status == 3
    assert "outside of chunks" in said
    assert said.count("\n") == 1


def test_chunks_that_are_packed_in_another_way_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("lz4", reason="no lz4 on this machine to write such a file with")
    path = written(tmp_path / "a.mcap", compression=CompressionType.LZ4)
    status, said, _ = analysed(path, capsys)
    assert status == 3
    assert "'lz4', which is not supported" in said


HEAD = b"\x89MCAP0\r\n" + struct.pack("<BQI10sI", 1, 18, 10, b"allanscope", 0)


def chunk(records: bytes, name: bytes = b"zstd") -> bytes:
    """Return a chunk record by hand."""
    packed = zstandard.compress(records) if name == b"zstd" else records
    body = struct.pack("<QQQII", 0, 0, len(records), zlib.crc32(records), len(name)) + name
    body += struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 6, len(body)) + body


def test_a_chunk_of_an_unknown_packing_is_said_without_a_library_for_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(HEAD + chunk(b"\0" * 64, b"lz4"))
    status, said, _ = analysed(path, capsys)
    assert status == 3
    assert "'lz4', which is not supported" in said


def test_a_chunk_of_more_empty_messages_than_ours_can_hold_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = struct.pack("<BQHIQQ", 5, 22, 1, 0, 0, 1)
    path = tmp_path / "a.mcap"
    path.write_bytes(HEAD + chunk(one * 2_000_000))
    assert path.stat().st_size < 100_000
    status, said, _ = analysed(path, capsys)
    assert status == 3
    assert f"more than {MOST_MESSAGES} messages" in said
    assert said.count("\n") == 1


def test_empty_messages_of_many_chunks_are_not_gathered_without_end(tmp_path: Path) -> None:
    one = struct.pack("<BQHIQQ", 5, 22, 1, 0, 0, 1)
    path = tmp_path / "a.mcap"
    path.write_bytes(HEAD + chunk(one * 200_000) * 4)
    longest = [len(buffer.offset) for buffer in Recording(path).buffers()]
    assert sum(longest) == 800_000
    assert max(longest) <= MOST_MESSAGES


def chunk_spans(data: bytes) -> list[tuple[int, int]]:
    """Return where the chunks of a file begin and end."""
    found, at = [], 8
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == 6:
            found.append((at, at + 9 + length))
        at += 9 + length
    return found


@pytest.mark.parametrize("doubled", [(0,), (1, 2), (-1,)])
def test_a_chunk_that_stands_there_twice_is_read_once_and_that_is_said(
    tmp_path: Path, doubled: tuple[int, ...]
) -> None:
    data = written(tmp_path / "a.mcap", chunk_size=4096).read_bytes()
    spans = chunk_spans(data)
    assert len(spans) > 3
    copies = b"".join(data[slice(*spans[one])] for one in doubled)
    end = spans[-1][1]
    (tmp_path / "b.mcap").write_bytes(data[:end] + copies + data[end:])
    whole, other = Recording(tmp_path / "a.mcap"), Recording(tmp_path / "b.mcap")
    assert list(other.chunks()) == list(whole.chunks())
    said = [str(damage) for damage in other.damage]
    assert len(said) == len(doubled)
    assert all("a duplicate chunk" in one for one in said)
    assert whole.damage == []
