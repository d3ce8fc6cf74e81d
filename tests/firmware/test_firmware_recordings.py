"""The sample recordings hold what their README says, to the sample."""

import re
from pathlib import Path

import numpy as np
import pytest

from allanscope.pipeline import Decoding
from allanscope.samples import Block, Gap, Notice, StreamInfo
from allanscope.sources import open_source
from allanscope.wire import WireSettings
from support.synthetic_sensor import count

RECORDINGS = Path(__file__).parents[2] / "recordings"
TOLD = {
    row[0]: row[1:]
    for row in re.findall(
        r"^\| `(\S+)` \| (\w+) \| (\d+) \| (\d+) \| (\d+) \| (\d+) \| (\d+) Hz \|$",
        (RECORDINGS / "README.md").read_text(),
        re.M,
    )
}


def decoded(name):
    """Return the format, the counters and the events of a recording."""
    source, decoding, events = open_source(str(RECORDINGS / name)), Decoding(WireSettings()), []
    while (chunk := source.read()).event != "end":
        events += decoding.feed(chunk)
    source.close()
    return decoding, events + decoding.finish()


def test_every_recording_is_in_the_table():
    there = {path.name for path in RECORDINGS.iterdir() if path.is_file()} - {"README.md"}
    assert there == set(TOLD)


@pytest.mark.parametrize("name", TOLD)
def test_a_recording_holds_exactly_what_its_readme_says(name):
    wire, *numbers, rate = TOLD[name]
    decoding, events = decoded(name)
    stats = decoding.stats
    assert decoding.wire == wire
    found = [stats.samples, stats.lost_samples, stats.frames, stats.bytes]
    assert found == [int(number) for number in numbers]
    assert not [event for event in events if isinstance(event, Gap)]
    info = next(event for event in events if isinstance(event, StreamInfo))
    assert info.nominal_hz == float(rate)


def test_every_count_of_the_emulated_board_is_the_synthetic_sensors():
    _, events = decoded("emulated-sensortile.mcap")
    info = next(event for event in events if isinstance(event, StreamInfo))
    assert info.part == "LSM6DSM"
    assert info.details["firmware"] == "1.0.0"
    blocks = [event for event in events if isinstance(event, Block)]
    index = np.concatenate([block.index + np.arange(len(block)) for block in blocks])
    np.testing.assert_array_equal(np.diff(index), 1)
    counts = np.concatenate([block.counts for block in blocks])
    expected = [[count(int(i), axis) for axis in range(6)] for i in index]
    np.testing.assert_array_equal(counts, expected)
    told = [e.fields for e in events if isinstance(e, Notice) and "dropped" in e.fields]
    assert len(told) > 100
    assert {fields["dropped"] for fields in told} == {0}  # as no index is missing
