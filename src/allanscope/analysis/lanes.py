"""Two cores for one stream: the deviations on one, all other sums on the other.

The sums of a stream do not depend on each other, and nearly all of their time is spent in compiled
code that lets go of the interpreter. So two threads halve the time of a replay. A live stream is
left on one: handing over a few rows would cost more than it saves.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

__all__ = ["WORTH_IT", "side_by_side"]

WORTH_IT = 1 << 15
"""Rows from which on a second thread pays: some milliseconds of work."""


def side_by_side(rows: int, one: Callable[[], None], other: Callable[[], None]) -> None:
    """Do two pieces of work that concern so many rows, together where that pays; wait for both."""
    if rows < WORTH_IT:
        one()
        other()
        return
    first = _threads().submit(one)
    try:
        other()
    finally:
        first.result()


@cache
def _threads() -> ThreadPoolExecutor:
    """Return the threads of this process, which wait for work and for nothing else."""
    return ThreadPoolExecutor(thread_name_prefix="sums")
