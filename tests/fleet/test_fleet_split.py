"""The plan of a split, in one process: survey, parts and join give what one pass gives."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from allanscope.fleet import split
from allanscope.fleet.places import find_places
from allanscope.fleet.split import Survey, join, sum_part, survey
from allanscope.fleet.work import analyse_place
from allanscope.pipeline.settings import DeviceSettings
from allanscope.recording import Chunk, Recording, write_recording

DEVICE = DeviceSettings()


@pytest.fixture
def torn(lot: Path, tmp_path: Path) -> Path:
    """Return a recording in which reads are missing: gaps of known length."""
    whole = Recording(lot / "one" / "a.mcap")
    chunks = list(whole.chunks())
    kept = [one for number, one in enumerate(chunks) if number % 90 not in (40, 41)]
    path = tmp_path / "torn.mcap"
    chunks_of_some = (Chunk(one.host_ns, one.data) for one in kept)
    return write_recording(path, chunks_of_some, whole.metadata)


def test_a_short_recording_is_not_split(lot: Path) -> None:
    [place] = find_places([str(lot / "two" / "a.mcap")])
    seen = survey(place, DEVICE, 2)
    assert seen == Survey(place)
    assert sum_part(place, None, 0, 2) is None
    assert join(seen, [None, None], DEVICE) == analyse_place(place, DEVICE)


@pytest.mark.parametrize("parts", [2, 5])
def test_joined_parts_are_the_whole(
    torn: Path, parts: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # So short a run is split for the sake of the test: all of it is rest, and rests are exact.
    monkeypatch.setattr(split, "_is_splittable", lambda analyser: True)
    [place] = find_places([str(torn)])
    seen = survey(place, DEVICE, parts)
    assert len(seen.cuts) == parts
    sums = [sum_part(place, cut, number, parts) for number, cut in enumerate(seen.cuts)]
    joined, whole = join(seen, sums, DEVICE), analyse_place(place, DEVICE)
    assert not whole.error
    assert joined == whole


def test_what_cannot_be_read_fails_once(tmp_path: Path, board: Callable[..., Path]) -> None:
    path = tmp_path / "empty.mcap"
    write_recording(path, [], {"wire": "native"})
    [place] = find_places([str(path)])
    assert "holds no samples" in join(survey(place, DEVICE, 2), [None, None], DEVICE).error
