"""What goes into a recording comes out of it, bit for bit, in one file or in many."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader

from allanscope.errors import InputError, UsageError
from allanscope.recording import (
    Chunk,
    LinkEvent,
    Recording,
    SessionWriter,
    is_recording,
    write_recording,
)

Session = Callable[..., tuple[Path, list[Chunk]]]

link_events: st.SearchStrategy[LinkEvent] = st.sampled_from(
    ["disconnected", "reconnected", "stalled", "resumed", "hole"]
)
chunks_of_a_source = st.lists(
    st.builds(Chunk, st.integers(0, 2**62), st.binary(min_size=1, max_size=300))
    | st.builds(Chunk, st.integers(0, 2**62), st.just(b""), link_events),
    max_size=60,
)


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(chunks_of_a_source)
def test_bytes_times_and_events_come_back_exactly(
    tmp_path_factory: pytest.TempPathFactory, chunks: list[Chunk]
) -> None:
    path = write_recording(tmp_path_factory.mktemp("r") / "session.mcap", chunks, {})
    assert list(Recording(path).chunks()) == chunks


def test_buffers_hold_the_same_reads_as_chunks(session: Session) -> None:
    path, chunks = session()
    buffers = list(Recording(path).buffers(size=1000))
    assert len(buffers) > 5
    assert all(buffer.offset[0] == 0 for buffer in buffers)
    assert [chunk for buffer in buffers for chunk in buffer.chunks()] == chunks


def test_event_and_bytes_of_one_read_come_back_as_neighbours(tmp_path: Path) -> None:
    path = write_recording(tmp_path / "a.mcap", [Chunk(7, b"x", "resumed")], {})
    assert list(Recording(path).chunks()) == [Chunk(7, b"", "resumed"), Chunk(7, b"x")]


def test_silence_and_the_end_are_not_recorded(tmp_path: Path) -> None:
    path = write_recording(
        tmp_path / "a.mcap", [Chunk(1), Chunk(2, b"x"), Chunk(3, b"", "end")], {}
    )
    assert list(Recording(path).chunks()) == [Chunk(2, b"x")]
    assert list(Recording(path).events()) == []


def test_commands_and_remarks_are_kept_beside_the_reads(tmp_path: Path) -> None:
    writer = SessionWriter(tmp_path / "a.mcap", {})
    writer.tx(b"start", 10)
    writer.rx(b"data", 20)
    writer.event({"kind": "mark", "text": "fan on", "n": 3}, 30)
    writer.close()
    recording = Recording(tmp_path / "a.mcap")
    assert list(recording.tx()) == [Chunk(10, b"start")]
    assert list(recording.events()) == [(30, {"kind": "mark", "text": "fan on", "n": 3})]
    assert list(recording.chunks()) == [Chunk(20, b"data"), Chunk(30, b"", "mark", "fan on")]
    assert recording.damage == []


def test_metadata_is_there_before_the_first_sample_and_grows_later(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = SessionWriter(path, {"part": "LSM6DSL", "path": "/dev/\udcff"})
    assert Recording(path).metadata["part"] == "LSM6DSL"
    writer.describe({"wire": "native"})
    writer.close()
    metadata = Recording(path).metadata
    assert (metadata["part"], metadata["wire"]) == ("LSM6DSL", "native")
    assert metadata["started"].endswith("+00:00")
    assert {"host", "allanscope", "session", "segment"} <= metadata.keys()


def test_log_time_is_the_wall_clock_of_one_anchor(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = SessionWriter(path, {}, anchor_ns=(1_700_000_000_000_000_000, 500))
    writer.rx(b"x", 1500)
    writer.close()
    with path.open("rb") as file:
        message = next(r for r in StreamReader(file).records if isinstance(r, Message))
    assert (message.publish_time, message.log_time) == (1500, 1_700_000_000_000_001_000)


@pytest.mark.parametrize("limit", [{"max_bytes": 3000}, {"max_seconds": 5.0}])
def test_a_long_session_grows_over_several_files(session: Session, limit: dict[str, float]) -> None:
    path, chunks = session(**limit)
    files = sorted(path.parent.glob("*.mcap"))
    assert [file.name for file in files][:2] == ["session-001.mcap", "session-002.mcap"]
    whole = Recording(path)
    assert whole.files[0] == path
    assert sorted(whole.files) == files
    assert list(whole.chunks()) == chunks
    assert list(Recording(path.parent).chunks()) == chunks
    assert whole.damage == []
    assert whole.metadata["segment"] == "0"


def test_every_file_of_a_session_stands_for_itself(session: Session) -> None:
    path, chunks = session(max_seconds=5.0)
    alone = Recording(path.with_name("session-001.mcap"))
    assert alone.metadata["part"] == "LSM6DSM"
    part = list(alone.chunks())
    assert part == chunks[60 : 60 + len(part)]


def test_a_missing_file_in_the_middle_is_a_hole(session: Session) -> None:
    path, _ = session(max_seconds=5.0)
    path.with_name("session-001.mcap").unlink()
    events = [chunk.event for chunk in Recording(path).chunks() if chunk.event]
    assert events == ["hole"]


def test_a_stranger_with_a_fitting_name_is_not_part_of_the_session(session: Session) -> None:
    path, chunks = session(name="run.mcap")
    session(name="run-001.mcap")
    assert list(Recording(path).chunks()) == chunks


def test_content_hash_does_not_depend_on_the_files(session: Session) -> None:
    one, _ = session(name="one.mcap")
    many, _ = session(name="many.mcap", max_seconds=3.0)
    other, _ = session(seconds=19, name="other.mcap")
    assert Recording(one).sha256() == Recording(many).sha256()
    assert Recording(one).sha256() != Recording(other).sha256()


def test_content_hash_knows_times_and_the_split_into_reads(tmp_path: Path) -> None:
    sessions = [
        [Chunk(1, b"ab"), Chunk(2, b"c")],
        [Chunk(1, b"a"), Chunk(2, b"bc")],
        [Chunk(1, b"ab"), Chunk(3, b"c")],
    ]
    paths = [write_recording(tmp_path / f"{n}.mcap", s, {}) for n, s in enumerate(sessions)]
    assert len({Recording(path).sha256() for path in paths}) == 3


def test_duration_is_from_the_first_read_to_the_last(session: Session) -> None:
    path, _ = session(seconds=20, max_seconds=5.0)
    assert Recording(path).duration_s == pytest.approx(19.9, abs=1e-9)


def test_a_recording_is_never_overwritten(session: Session) -> None:
    path, chunks = session()
    with pytest.raises(UsageError, match=r"session\.mcap exists"):
        SessionWriter(path, {})
    assert list(Recording(path).chunks()) == chunks


def test_a_resumed_session_goes_on_in_a_new_file_after_a_hole(session: Session) -> None:
    path, chunks = session(close=False)
    writer = SessionWriter(path, {}, resume=True)
    writer.chunk(Chunk(99, b"later"))
    writer.close()
    recording = Recording(path)
    assert [file.name for file in recording.files] == ["session.mcap", "session-001.mcap"]
    assert list(recording.chunks()) == [*chunks, Chunk(99, b"", "hole"), Chunk(99, b"later")]
    assert recording.metadata["part"] == "LSM6DSM"
    with pytest.raises(UsageError, match="no session to resume"):
        SessionWriter(path.with_name("other.mcap"), {}, resume=True)


def test_the_reference_reader_accepts_the_file(session: Session) -> None:
    path, chunks = session()
    with path.open("rb") as file:
        records = list(StreamReader(file, validate_crcs=True).records)
    assert isinstance(records[1], Metadata)
    topics = {record.topic: record.id for record in records if isinstance(record, Channel)}
    assert topics == {"/serial/rx": 1, "/serial/tx": 2, "/events": 3}
    with path.open("rb") as file:
        found = [m.data for _, _, m in make_reader(file).iter_messages(topics=["/serial/rx"])]
    assert found == [chunk.data for chunk in chunks]


def test_a_folder_must_hold_exactly_one_session(session: Session, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="contains no recording"):
        Recording(tmp_path)
    session(name="a.mcap")
    assert is_recording(tmp_path)
    session(name="b.mcap")
    with pytest.raises(InputError, match="2 recordings"):
        Recording(tmp_path)


@pytest.mark.parametrize("content", [b"", b"gx,gy\n1,2\n", b"\x89PNG\r\n\x1a\n" + bytes(100)])
def test_other_files_are_no_recording(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match="not a recording" if content else "is empty"):
        Recording(path)
    path.rename(tmp_path / "x.txt")
    assert not is_recording(tmp_path / "x.txt")


def test_someone_elses_mcap_is_no_recording(tmp_path: Path) -> None:
    from mcap.writer import Writer

    path = tmp_path / "robot.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "x")
        channel = writer.register_channel("/imu", "cdr", 0)
        writer.add_message(channel, 1, b"x", 1)
        writer.finish()
    with pytest.raises(InputError, match="something else"):
        Recording(path)


def test_a_missing_file_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read .*nothing\.mcap: No such file"):
        Recording(tmp_path / "nothing.mcap")
