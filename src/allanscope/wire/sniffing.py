"""Recognise the format that a port speaks.

Each format scores a sample of what was heard, from 0 (surely not) to 1 (surely); the best one wins
if it is good enough. Two seconds are enough, with garbage before and half a frame at either end.
Where none fits, the user is shown what the port said, escaped.
"""

from __future__ import annotations

from dataclasses import dataclass

from allanscope.sanitize import excerpt
from allanscope.wire.registry import format_named, formats

__all__ = ["SniffResult", "sniff"]

_GOOD_ENOUGH = 0.5
_LONGEST_SAMPLE = 1 << 18


@dataclass(frozen=True, slots=True)
class SniffResult:
    """What a sample of bytes seems to be.

    Attributes
    ----------
    name : str or None
        The format, or None when none fits.
    scores : dict
        Score of every format.
    excerpt : str
        The beginning of the sample, escaped and printable.
    """

    name: str | None
    scores: dict[str, float]
    excerpt: str


def sniff(sample: bytes) -> SniffResult:
    """Decide which format the first seconds of a stream are in.

    Parameters
    ----------
    sample : bytes
        What was heard; of more than 256 KiB only the beginning is looked at.
    """
    sample = sample[:_LONGEST_SAMPLE]
    scores = {name: format_named(name).score(sample) for name in formats()}
    best = max(scores, key=lambda name: scores[name])
    return SniffResult(best if scores[best] >= _GOOD_ENOUGH else None, scores, excerpt(sample))
