"""Fuzz one decoder with coverage guidance, for as long as one likes; an optional job.

    pip install atheris
    python tests/fuzz/with_atheris.py native -max_total_time=600
    python tests/fuzz/with_atheris.py recording -max_total_time=600

The first argument is a wire format, ``sniff`` or ``recording``; the rest goes to libFuzzer.
Whatever is not an event or an `AllanscopeError` ends it with the input that did it.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["allanscope"]):
    from allanscope.analysis import Analyser
    from allanscope.errors import AllanscopeError
    from allanscope.recording import Recording
    from allanscope.wire import WireSettings, format_named, sniff


def decode(name: str) -> Callable[[bytes], None]:
    with atheris.instrument_imports(include=["allanscope"]):
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


def main() -> None:
    """Choose what to fuzz and hand over to libFuzzer."""
    what = sys.argv[1] if len(sys.argv) > 1 else "native"
    targets = {"sniff": lambda: sniff, "recording": read_recording}
    target = targets[what]() if what in targets else decode(what)
    atheris.Setup([sys.argv[0], *sys.argv[2:]], target)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
