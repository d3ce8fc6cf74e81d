"""What damage costs: a torn end, a flipped byte, zeros that a crash left, rot in the headers."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.opcode import Opcode

from allanscope.errors import InputError, UsageError
from allanscope.recording import Chunk, Recording, SessionWriter, recover
from allanscope.recording.outline import outline_of

Session = Callable[..., tuple[Path, list[Chunk]]]

SECONDS = 20
READS_PER_SECOND = 10
INDEX_BYTES = 9 + 6 + 16 * READS_PER_SECOND
"""The record after each chunk that says where its messages begin."""


def read_back(path: Path) -> list[Chunk]:
    return [chunk for chunk in Recording(path).chunks() if chunk.data]


@pytest.mark.parametrize("seed", range(30))
def test_a_torn_file_gives_every_second_before_the_tear(session: Session, seed: int) -> None:
    path, chunks = session(SECONDS)
    whole = path.read_bytes()
    starts = [record.offset for record in outline_of(path).chunks]
    ends = [record.offset + record.length for record in outline_of(path).chunks]
    cut = random.Random(seed).randrange(starts[0], len(whole))
    path.write_bytes(whole[:cut])
    complete = sum(end <= cut for end in ends)
    recording = Recording(path)
    assert list(recording.chunks()) == chunks[: complete * READS_PER_SECOND]
    assert recording.damage or complete == SECONDS


def test_a_killed_file_says_that_it_was_never_closed(session: Session) -> None:
    path, chunks = session(close=False)
    recording = Recording(path)
    assert list(recording.chunks()) == chunks
    assert [str(one) for one in recording.damage] == [
        f"session.mcap, byte {path.stat().st_size}: never closed: up to a second at its end may "
        "be missing"
    ]


@pytest.mark.parametrize("seed", range(150))
def test_one_flipped_byte_costs_at_most_a_second(session: Session, seed: int) -> None:
    path, chunks = session(SECONDS)
    whole = bytearray(path.read_bytes())
    source = random.Random(seed)
    position = source.randrange(len(whole))
    whole[position] ^= source.randrange(1, 256)
    path.write_bytes(whole)
    recording = Recording(path)
    found = list(recording.chunks())
    missing = [chunk for chunk in chunks if chunk not in found]
    assert len(missing) <= READS_PER_SECOND
    assert [chunk for chunk in found if chunk.data] == [c for c in chunks if c not in missing]
    inside = missing and missing[0] != chunks[0] and missing[-1] != chunks[-1]
    assert [chunk.event for chunk in found if chunk.event] == (["hole"] if inside else [])
    if missing:
        assert recording.damage


@pytest.mark.parametrize(
    ("part", "cost"),
    [
        ("header", 0),
        ("metadata", 0),
        ("index record", 0),
        ("index length", 0),
        ("chunk", READS_PER_SECOND),
        ("chunk length", READS_PER_SECOND),
    ],
)
@pytest.mark.parametrize("value", [0, 2, 4, 7, 0x0C, 0x0E, 0x0F, 0x40, 0xFF])
def test_rot_in_a_header_never_swallows_what_follows(
    session: Session, part: str, cost: int, value: int
) -> None:
    path, chunks = session(SECONDS)
    whole = bytearray(path.read_bytes())
    third = outline_of(path).chunks[2]
    head = 9 + 32 + 4 + 8
    position = {
        "header": 9,
        "metadata": 8 + 9 + len("allanscope") * 2 + 8 + 2,
        "index record": third.offset + third.length,
        "index length": third.offset + third.length + 2,
        "chunk": third.offset - head,
        "chunk length": third.offset - head + 2,
    }[part]
    whole[position] = value if whole[position] != value else value ^ 1
    path.write_bytes(whole)
    assert len(chunks) - len(read_back(path)) == cost
    if cost:
        assert Recording(path).damage


def test_rot_between_data_and_index_is_no_tear(session: Session) -> None:
    path, chunks = session(SECONDS)
    whole = bytearray(path.read_bytes())
    last = outline_of(path).chunks[-1]
    end_of_data = last.offset + last.length + INDEX_BYTES
    assert whole[end_of_data] == Opcode.DATA_END
    whole[end_of_data] = 0
    path.write_bytes(whole)
    recording = Recording(path)
    assert list(recording.chunks()) == chunks
    assert [(one.offset, one.length) for one in recording.damage] == [(end_of_data, 9 + 4)]


def test_zeros_at_the_end_cost_only_what_they_cover(session: Session) -> None:
    path, chunks = session(SECONDS, close=False)
    whole = path.read_bytes()
    record = outline_of(path).chunks[14]
    path.write_bytes(whole[: record.offset + 5] + bytes(len(whole) - record.offset - 5))
    recording = Recording(path)
    assert list(recording.chunks()) == chunks[: 14 * READS_PER_SECOND]
    assert any("truncated" in one.what for one in recording.damage)


def test_rotten_metadata_is_told_and_the_next_record_used(session: Session) -> None:
    path, _ = session(5)
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"LSM6DSM", b"LSM6DSL"))
    recording = Recording(path)
    assert recording.metadata["part"] == "LSM6DSL"
    assert [one.what for one in recording.damage] == ["the metadata is damaged"]


def test_a_sound_metadata_record_is_preferred_to_a_newer_one_that_has_rotted(
    tmp_path: Path,
) -> None:
    writer = SessionWriter(tmp_path / "a.mcap", {"part": "LSM6DSM"})
    writer.describe({"wire": "native"})
    writer.close()
    whole = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(whole.replace(b"native", b"naXive"))
    recording = Recording(tmp_path / "a.mcap")
    assert recording.metadata["part"] == "LSM6DSM"
    assert "wire" not in recording.metadata
    assert [one.what for one in recording.damage] == ["the metadata is damaged"]


def test_a_lost_beginning_does_not_lose_the_rest(session: Session) -> None:
    path, chunks = session(SECONDS)
    whole = path.read_bytes()
    path.write_bytes(bytes(300) + whole[300:])
    assert read_back(path) == chunks


def test_a_lost_index_loses_nothing(session: Session) -> None:
    path, chunks = session(SECONDS)
    last = outline_of(path).chunks[-1]
    whole = path.read_bytes()
    start = last.offset + last.length
    path.write_bytes(whole[:start] + random.Random(0).randbytes(len(whole) - start))
    assert read_back(path) == chunks


def test_recovery_saves_what_can_be_read_and_says_what_cannot(
    session: Session, tmp_path: Path
) -> None:
    path, chunks = session(SECONDS, close=False)
    whole = bytearray(path.read_bytes())
    records = outline_of(path).chunks
    whole[records[6].offset + 20] ^= 0xFF
    torn = records[-1].offset + 100
    path.write_bytes(whole[:torn])
    report = recover(path, tmp_path / "saved.mcap")
    kept = chunks[:60] + chunks[70:190]
    saved = Recording(tmp_path / "saved.mcap")
    assert [chunk for chunk in saved.chunks() if chunk.data] == kept
    assert [chunk.event for chunk in saved.chunks() if chunk.event] == ["hole"]
    assert saved.damage == []
    assert saved.metadata["part"] == "LSM6DSM"
    assert (report.reads, report.lost_reads) == (180, 10)
    assert report.bytes == sum(len(chunk.data) for chunk in kept)
    assert report.lost_s == pytest.approx(1.1 + 0.9)
    last = records[-2].offset + records[-2].length + INDEX_BYTES
    assert [one.length for one in report.damage] == [records[6].length, torn - last]
    assert "Lost: 10 reads, at most 2.0 s" in str(report)


def test_recovery_of_a_sound_recording_says_that_nothing_was_lost(
    session: Session, tmp_path: Path
) -> None:
    path, _ = session(SECONDS)
    report = recover(path, tmp_path / "saved.mcap")
    assert str(report).endswith("bytes; lost: none")


def test_recovery_keeps_commands_remarks_and_link_events(tmp_path: Path) -> None:
    writer = SessionWriter(tmp_path / "a.mcap", {})
    writer.tx(b"start", 1)
    writer.chunk(Chunk(2, b"x"))
    writer.chunk(Chunk(3, b"", "disconnected"))
    writer.event({"kind": "mark", "text": "here"}, 4)
    writer.commit()
    recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    before, after = Recording(tmp_path / "a.mcap"), Recording(tmp_path / "b.mcap")
    assert list(after.tx()) == list(before.tx())
    assert list(after.events()) == list(before.events())
    assert list(after.chunks()) == list(before.chunks())
    assert after.sha256() == before.sha256()


def test_recovery_joins_the_files_of_a_session(session: Session, tmp_path: Path) -> None:
    path, chunks = session(SECONDS, max_seconds=5.0)
    report = recover(path, tmp_path / "saved.mcap")
    assert list(Recording(tmp_path / "saved.mcap").chunks()) == chunks
    assert report.lost_reads == 0


def test_recovery_never_touches_a_file_that_exists(session: Session) -> None:
    path, _ = session()
    before = path.read_bytes()
    with pytest.raises(UsageError, match="exists"):
        recover(path, path)
    assert path.read_bytes() == before


def test_a_recovery_that_fails_leaves_nothing_behind(session: Session, tmp_path: Path) -> None:
    path, _ = session()
    with pytest.raises(UsageError, match="cannot write"):
        recover(path, tmp_path / "nowhere" / "saved.mcap")
    (tmp_path / "empty").mkdir()
    whole = path.read_bytes()
    path.write_bytes(whole[: outline_of(path).chunks[0].offset])
    with pytest.raises(InputError, match="no readable data"):
        recover(path, tmp_path / "empty" / "saved.mcap")
    assert list((tmp_path / "empty").iterdir()) == []
