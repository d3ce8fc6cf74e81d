"""A recording read in parts is the recording."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from allanscope.recording import Chunk, Recording


@pytest.mark.parametrize("parts", [1, 2, 7, 40])
def test_the_parts_are_the_whole(
    session: Callable[..., tuple[Path, list[Chunk]]], parts: int
) -> None:
    path, chunks = session(20, max_seconds=7.0)
    recording = Recording(path)
    after, found = 0, []
    for number in range(parts):
        part = recording.part(number, parts)
        found += [one for buffer in part.buffers(after=after) for one in buffer.chunks()]
        after = part.next_read(after)
    assert found == chunks == list(recording.chunks())
    assert after == len(chunks) + 1


def test_a_hole_between_two_parts_is_seen(
    session: Callable[..., tuple[Path, list[Chunk]]],
) -> None:
    path, _ = session(20)
    recording = Recording(path)
    last = recording.part(3, 4)
    before = recording.part(1, 4).next_read()
    assert next(last.buffers(after=before)).event == "hole"
    assert not next(last.buffers(after=recording.part(2, 4).next_read())).event
