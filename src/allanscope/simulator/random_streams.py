"""Random numbers: one independent, named stream for every process of every axis.

A device is reproducible when each of its processes draws from a stream of its own: then adding an
effect, leaving an axis out or reading in other portions changes nothing else. The name is part of
the seed, so no process needs to know which others exist.
"""

from __future__ import annotations

from zlib import crc32

from numpy.random import SFC64, Generator, SeedSequence

from allanscope.errors import UsageError

__all__ = ["stream"]


def stream(seed: int, *name: str) -> Generator:
    """Return the generator that belongs to `seed` and to a name such as ``("gx", "flicker")``.

    Raises
    ------
    UsageError
        If the seed is negative.

    Examples
    --------
    >>> stream(1, "gx", "white").random() == stream(1, "gx", "white").random()
    True
    >>> stream(1, "gx", "white").random() == stream(1, "gy", "white").random()
    False
    """
    if seed < 0:
        raise UsageError(f"a seed is 0 or more, not {seed}")
    return Generator(SFC64(SeedSequence([seed, *(crc32(word.encode()) for word in name)])))
