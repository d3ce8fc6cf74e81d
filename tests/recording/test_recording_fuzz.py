"""Whatever a file holds, reading it ends: with what could be read, or with an InputError."""

from __future__ import annotations

import random
import struct
import tracemalloc
import zlib
from pathlib import Path

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from allanscope.errors import InputError
from allanscope.recording import Chunk, Recording, is_recording, write_recording
from allanscope.recording.layout import MCAP_MAGIC


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def sample(folder: Path) -> bytes:
    source = random.Random(3)
    chunks = [Chunk(n, source.randbytes(50)) for n in range(40)]
    return write_recording(folder / "sample.mcap", chunks, {"part": "LSM6DSM"}).read_bytes()


def read_everything(path: Path) -> int:
    """Use the whole of the reader; return the bytes it gave, none if it refused the file."""
    is_recording(path)
    try:
        recording = Recording(path)
    except InputError:
        return 0
    list(recording.events())
    list(recording.tx())
    assert recording.duration_s == recording.duration_s
    assert all(str(one) for one in recording.damage)
    assert recording.metadata is not None
    return sum(len(chunk.data) for chunk in recording.chunks())


@settings(max_examples=150, deadline=None)
@given(st.binary(max_size=600), st.booleans())
def test_any_bytes(folder: Path, content: bytes, magic: bool) -> None:
    path = folder / "any.mcap"
    path.write_bytes(MCAP_MAGIC * magic + content)
    read_everything(path)


@settings(max_examples=250, deadline=None)
@given(
    edits=st.lists(
        st.tuples(st.floats(0, 1, exclude_max=True), st.binary(max_size=12), st.integers(0, 30)),
        max_size=5,
    )
)
def test_any_edit_of_a_real_file(
    folder: Path, sample: bytes, edits: list[tuple[float, bytes, int]]
) -> None:
    content = sample
    for where, inserted, removed in edits:
        at = int(where * len(content))
        content = content[:at] + inserted + content[at + removed :]
    path = folder / "edited.mcap"
    path.write_bytes(content)
    assert read_everything(path) <= 40 * 50


def chunk_record(
    packed: bytes, *, unpacked_size: int, crc: int = 0, name: bytes = b"zstd"
) -> bytes:
    body = struct.pack("<QQQII", 1, 2, unpacked_size, crc, len(name)) + name
    body += struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 6, len(body)) + body


def message_record(data: bytes, channel: int = 1) -> bytes:
    return struct.pack("<BQHIQQ", 5, 22 + len(data), channel, 1, 1, 1) + data


HEADER = MCAP_MAGIC + struct.pack("<BQI", 1, 18, 10) + b"allanscope" + struct.pack("<I", 0)


@pytest.mark.parametrize("honest", [True, False])
def test_a_decompression_bomb_is_refused_before_it_is_unpacked(folder: Path, honest: bool) -> None:
    size = 1 << 30
    packer = zstandard.ZstdCompressor(level=1).compressobj(size=size)
    packed = b"".join(packer.compress(bytes(1 << 20)) for _ in range(1 << 10)) + packer.flush()
    path = folder / "bomb.mcap"
    path.write_bytes(HEADER + chunk_record(packed, unpacked_size=size if honest else 1000))
    tracemalloc.start()
    assert read_everything(path) == 0
    assert tracemalloc.get_traced_memory()[1] < 50 << 20
    tracemalloc.stop()
    assert Recording(path).damage


def test_a_size_that_nobody_can_check_is_not_believed(folder: Path) -> None:
    """A frame that does not say how much it holds, in a chunk that promises terabytes."""
    packer = zstandard.ZstdCompressor().compressobj()
    packed = packer.compress(b"x" * 100) + packer.flush()
    assert zstandard.frame_content_size(packed) == -1
    path = folder / "promise.mcap"
    path.write_bytes(HEADER + chunk_record(packed, unpacked_size=1 << 42))
    assert read_everything(path) == 0
    assert Recording(path).damage


@pytest.mark.parametrize("length", [0, 8, 2**31, 2**63, 2**64 - 1])
@pytest.mark.parametrize("opcode", range(0, 17))
def test_lengths_that_cannot_be_are_not_believed(folder: Path, opcode: int, length: int) -> None:
    inside = message_record(b"kept")
    good = chunk_record(
        zstandard.compress(inside), unpacked_size=len(inside), crc=zlib.crc32(inside)
    )
    path = folder / "length.mcap"
    path.write_bytes(HEADER + struct.pack("<BQ", opcode, length) + good)
    tracemalloc.start()
    kept = read_everything(path)
    assert tracemalloc.get_traced_memory()[1] < 10 << 20
    tracemalloc.stop()
    assert kept in (0, 4)
    if length > 8:
        assert kept == 4


@pytest.mark.parametrize(
    "inside",
    [
        message_record(b"x")[:-1] + b"",
        struct.pack("<BQ", 5, 3) + b"abc" + message_record(b"y"),
        struct.pack("<BQ", 5, 2**63),
        struct.pack("<BQ", 4, 8) + struct.pack("<HHI", 9, 0, 99),
        struct.pack("<BQ", 4, 10) + struct.pack("<HHI", 9, 0, 2) + b"\xff\xff",
        b"\x05",
        message_record(b"[" * 5000, channel=3),
        message_record(b'{"kind": "link", "event": ["x"]}', channel=3),
        message_record(b'{"kind": "link", "event": "end"}', channel=3),
        message_record(b"\xff\xfe", channel=3),
    ],
)
def test_strange_records_within_a_sound_chunk(folder: Path, inside: bytes) -> None:
    path = folder / "strange.mcap"
    record = chunk_record(inside, unpacked_size=len(inside), crc=zlib.crc32(inside), name=b"")
    path.write_bytes(HEADER + record)
    assert read_everything(path) <= 1


def test_a_short_last_record_of_a_chunk_is_no_damage(folder: Path) -> None:
    inside = message_record(b"data") + struct.pack("<BQ", 0x7F, 2) + b"ab"
    path = folder / "short.mcap"
    record = chunk_record(inside, unpacked_size=len(inside), crc=zlib.crc32(inside), name=b"")
    path.write_bytes(HEADER + record)
    assert read_everything(path) == 4
    assert [one.what.split(":")[0] for one in Recording(path).damage] == ["never closed"]


def test_another_compression_is_told_by_its_name(folder: Path) -> None:
    path = folder / "lz4.mcap"
    path.write_bytes(HEADER + chunk_record(b"xxxx", unpacked_size=4, name=b"lz4"))
    assert "packed with 'lz4'" in str(Recording(path).damage[0])
