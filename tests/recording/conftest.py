"""Sessions with known content: noise, so that it packs like noise and no two reads are alike."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest

from allanscope.recording import Chunk, SessionWriter

READS_PER_SECOND = 10
READ_NS = 100_000_000


def reads(count: int, seed: int = 1, start: int = 0) -> list[Chunk]:
    """Return reads of uneven size at even times, as a slow device gives them."""
    source = random.Random(seed)
    sizes = [source.randrange(40, 200) for _ in range(start + count)]
    data = [source.randbytes(size) for size in sizes]
    return [
        Chunk(5_000_000_123 + index * READ_NS, data[index]) for index in range(start, start + count)
    ]


@pytest.fixture
def session(tmp_path: Path) -> Callable[..., tuple[Path, list[Chunk]]]:
    """Return a function that writes a session, one MCAP chunk a second, and what it wrote."""

    def write(
        seconds: int = 20, *, close: bool = True, name: str = "session.mcap", **settings: float
    ) -> tuple[Path, list[Chunk]]:
        path = tmp_path / name
        chunks = reads(seconds * READS_PER_SECOND)
        writer = SessionWriter(path, {"part": "LSM6DSM", "serial": "0001"}, **settings)  # type: ignore[arg-type]
        for number, chunk in enumerate(chunks, 1):
            writer.chunk(chunk)
            if number % READS_PER_SECOND == 0:
                writer.commit()
        if close:
            writer.close()
        return path, chunks

    return write
