"""The last words of a fleet on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from allanscope.fleet.desk import FleetResult

__all__ = ["summary_lines"]


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
    if result.failures:
        text += f"; {len(result.failures)} failed"
    if result.left:
        text += f"; {result.left} left: the same command goes on"
    files = [str(path) for path in (result.table, result.report) if path is not None]
    return [text, *files]
