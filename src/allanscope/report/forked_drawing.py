"""All pictures of a page at once, on two cores.

Drawing is plain Python, which computes on one core, and the pictures do not depend on each other. A
copy of the process (fork) has everything that there is to draw and gives back text. The two take
the next picture from a pipe that both read, until it is empty.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterator, Mapping

__all__ = ["draw_forked"]

_MOST = 255
"""Numbers that are one byte."""


def draw_forked(tasks: Mapping[str, Callable[[], str]]) -> dict[str, str]:
    """Return what each task returns, half of them done by a copy of this process.

    For a process with a single thread: of others a copy may wait for ever. Where there is no fork,
    and for what the copy leaves undone, the tasks are done here.

    Parameters
    ----------
    tasks : mapping of str to callable
        Each returns a text.

    Examples
    --------
    >>> draw_forked({"gx": lambda: "<svg>1</svg>", "gy": lambda: "<svg>2</svg>"})
    {'gx': '<svg>1</svg>', 'gy': '<svg>2</svg>'}
    """
    names = list(tasks)
    if not hasattr(os, "fork") or not 1 < len(names) <= _MOST:
        return {name: task() for name, task in tasks.items()}
    numbers, filling = os.pipe()
    os.write(filling, bytes(range(len(names))))
    os.close(filling)
    answer, answering = os.pipe()
    copy = os.fork()
    if copy == 0:
        try:
            with os.fdopen(answering, "wb") as pipe:
                pickle.dump({names[k]: tasks[names[k]]() for k in _taken(numbers)}, pipe)
        finally:
            os._exit(0)  # without what the end of a process does: the pipes are not ours
    os.close(answering)
    try:
        with os.fdopen(answer, "rb") as pipe:
            done = {names[k]: tasks[names[k]]() for k in _taken(numbers)}
            text = pipe.read()
    finally:
        os.waitpid(copy, 0)
        os.close(numbers)
    if text.endswith(pickle.STOP):
        done |= pickle.loads(text)
    return {name: done[name] if name in done else task() for name, task in tasks.items()}


def _taken(numbers: int) -> Iterator[int]:
    """Yield numbers from a pipe until nobody has put any more there."""
    while taken := os.read(numbers, 1):
        yield taken[0]
