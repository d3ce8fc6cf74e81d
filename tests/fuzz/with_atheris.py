"""Fuzz one decoder with coverage guidance, for as long as one likes; an optional job.

    pip install atheris
    python tests/fuzz/with_atheris.py native -max_total_time=600
    python tests/fuzz/with_atheris.py recording -max_total_time=600 FOLDER

The first argument is a wire format, ``sniff``, ``recording`` (MCAP), ``json`` or ``toml`` (a truth
to simulate) or ``specification`` (TOML); the rest goes to libFuzzer, with a folder for what reaches
new code. Whatever is not an event or an `AllanscopeError` ends it with the input that did it.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import atheris
import numpy as np

with atheris.instrument_imports(include=["allanscope", "tomllib"]):
    from allanscope.analysis import Analyser
    from allanscope.errors import AllanscopeError
    from allanscope.pipeline.check import read_limits as read_specification
    from allanscope.recording import Recording
    from allanscope.simulator import Simulator, Truth
    from allanscope.wire import WireSettings, format_named, sniff


def decode(name: str) -> Callable[[bytes], None]:
    with atheris.instrument_imports(include=["allanscope", "tomllib"]):
        format_named(name).decoder(WireSettings())  # formats are imported when they are asked for

    def one_input(data: bytes) -> None:
        decoder, analyser = format_named(name).decoder(WireSettings()), Analyser()
        cut = data[0] if data else 0
        for event in [*decoder.feed(data[:cut], 1.0), *decoder.feed(data[cut:], 2.0)]:
            analyser.feed(event)
        for event in decoder.finish():
            analyser.feed(event)

    return one_input


def read_recording() -> Callable[[bytes], None]:
    path = Path(tempfile.mkdtemp()) / "fuzz.mcap"

    def one_input(data: bytes) -> None:
        path.write_bytes(b"\x89MCAP0\r\n" + data)
        with contextlib.suppress(AllanscopeError):
            recording = Recording(path)
            for _ in recording.chunks():
                pass
            list(recording.events())

    return one_input


def read_document(name: str, take: Callable[[Path], object]) -> Callable[[bytes], None]:
    path = Path(tempfile.mkdtemp()) / name

    def one_input(data: bytes) -> None:
        path.write_bytes(data)
        with contextlib.suppress(AllanscopeError), np.errstate(all="ignore"):
            take(path)

    return one_input


def take_truth(path: Path) -> None:
    Simulator(truth=Truth.load(path), duration_s=1.0).read(20)


def main() -> None:
    """Choose what to fuzz and hand over to libFuzzer."""
    what = sys.argv[1] if len(sys.argv) > 1 else "native"
    targets = {
        "sniff": lambda: sniff,
        "recording": read_recording,
        "json": lambda: read_document("truth.json", take_truth),
        "toml": lambda: read_document("truth.toml", take_truth),
        "specification": lambda: read_document("spec.toml", read_specification),
    }
    target = targets[what]() if what in targets else decode(what)
    atheris.Setup([sys.argv[0], *sys.argv[2:]], target)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
