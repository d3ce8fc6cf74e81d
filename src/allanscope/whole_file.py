"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from allanscope.errors import UsageError

__all__ = ["written_whole"]


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield the name of a file to write beside `path`, which takes its place when all went well.

    Whatever was at `path` stays until then, and for good when the block raises; the other file is
    gone in every case. What is there afterwards survives a power cut.

    Raises
    ------
    UsageError
        When the place cannot be written to.

    Examples
    --------
    >>> with written_whole(Path("curve.csv")) as part:  # doctest: +SKIP
    ...     part.write_text("tau,deviation")
    """
    part = path.with_name(f".{path.name}.part")
    try:
        part.unlink(missing_ok=True)
        yield part
        with part.open("r+b") as file:
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        why = error.strerror or error
        raise UsageError(f"cannot write {path}: {why}; choose another place") from error
    finally:
        part.unlink(missing_ok=True)
