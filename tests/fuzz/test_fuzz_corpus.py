"""What coverage-guided fuzzing has found new ways through the decoders with is taken once more.

``with_atheris.py`` adds to such a corpus; the file holds it in base64, a list for each target.
"""

from __future__ import annotations

import base64
import contextlib
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from allanscope.analysis import Analyser
from allanscope.errors import AllanscopeError
from allanscope.pipeline import read_limits
from allanscope.recording import Recording
from allanscope.simulator import Simulator, Truth
from allanscope.wire import WireSettings, format_named, sniff

CORPUS: dict[str, list[str]] = json.loads(
    Path(__file__).with_name("corpus.json").read_text("ascii")
)


def take_truth(path: Path) -> None:
    """Read a sensor, and take some samples of it."""
    Simulator(truth=Truth.load(path), duration_s=1.0).read(20)


DOCUMENTS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "json": ("truth.json", take_truth),
    "toml": ("truth.toml", take_truth),
    "specification": ("spec.toml", read_limits),
}
"""Name of the file, and who reads it."""


def inputs(target: str) -> list[bytes]:
    return [base64.b64decode(one) for one in CORPUS[target]]


@pytest.mark.parametrize("name", sorted(CORPUS.keys() - {"recording", "sniff", *DOCUMENTS}))
def test_every_way_through_a_decoder_ends_in_events(name: str) -> None:
    for data in inputs(name):
        decoder, analyser = format_named(name).decoder(WireSettings()), Analyser()
        cut = data[0] if data else 0
        for event in [*decoder.feed(data[:cut], 1.0), *decoder.feed(data[cut:], 2.0)]:
            analyser.feed(event)
        for event in decoder.finish():
            analyser.feed(event)


def test_every_way_through_sniffing_ends_with_a_format_or_none() -> None:
    for data in inputs("sniff"):
        sniff(data)


def test_every_way_through_a_recording_ends_with_its_chunks_or_one_error(tmp_path: Path) -> None:
    path = tmp_path / "fuzz.mcap"
    for data in inputs("recording"):
        path.write_bytes(b"\x89MCAP0\r\n" + data)
        with contextlib.suppress(AllanscopeError):
            recording = Recording(path)
            list(recording.chunks())
            list(recording.events())


@pytest.mark.parametrize("kind", DOCUMENTS)
def test_every_way_through_a_document_ends_with_what_it_says_or_one_error(
    kind: str, tmp_path: Path
) -> None:
    name, take = DOCUMENTS[kind]
    for data in inputs(kind):
        (tmp_path / name).write_bytes(data)
        with contextlib.suppress(AllanscopeError), np.errstate(all="ignore"):
            take(tmp_path / name)
