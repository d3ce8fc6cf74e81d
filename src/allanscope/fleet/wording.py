"""The last words of a fleet on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from allanscope.fleet.desk import FleetResult

__all__ = ["complaint_lines", "summary_lines"]

MOST_LINES = 20
"""Of one kind; the report has them all."""


def complaint_lines(result: FleetResult) -> list[str]:
    """Return what went wrong, recording by recording, the worst first.

    Examples
    --------
    >>> from allanscope.fleet.desk import FleetResult
    >>> complaint_lines(FleetResult(failures={"c": "c is empty"}, copies={"b": "a"}, left=2))
    ['c is empty', 'b is a copy of a: left out of the lot',
     'stopped before it was done; 2 recordings left: the same command goes on']
    """
    copies = [f"{one} is a copy of {other}: left out of the lot" for one, other in _sorted(result)]
    lines = [*result.failures.values(), *_some([str(one) for one in result.losses]), *_some(copies)]
    if result.left:
        left = f"{result.left} recording{'s' * (result.left != 1)} left"
        lines.append(f"stopped before it was done; {left}: the same command goes on")
    return lines


def summary_lines(result: FleetResult) -> list[str]:
    """Return what was done, what was not, and where it is.

    Examples
    --------
    >>> from allanscope.fleet.desk import FleetResult
    >>> summary_lines(FleetResult({"a": "1", "b": "2"}, 1, {"c": "c is empty"}, left=4))
    ['2 recordings analysed, 1 of them before; 1 failed; 4 left: the same command goes on']
    """
    ready = len(result.keys)
    before = ready - result.done
    text = f"{ready} recording{'s' * (ready != 1)} analysed"
    if before:
        text += f", {before} of them before"
    if result.copies:
        text += f", {len(result.copies)} of them copies"
    if result.losses:
        text += f"; {len(result.losses)} incomplete"
    if result.failures:
        text += f"; {len(result.failures)} failed"
    if result.left:
        text += f"; {result.left} left: the same command goes on"
    files = [str(path) for path in (result.table, result.report) if path is not None]
    return [text, *files]


def _sorted(result: FleetResult) -> list[tuple[str, str]]:
    return sorted(result.copies.items())


def _some(lines: Sequence[str]) -> list[str]:
    more = len(lines) - MOST_LINES
    return [*lines[:MOST_LINES], *([f"and {more} more like this"] if more > 0 else [])]
