"""What a benchmark has to say: a few figures, each beside its goal, its peer and its bound.

Every script in this folder that has a ``main`` is a benchmark. It understands ``--quick`` and
``--json FILE``, and writes an object with the list ``figures`` to it; ``python -m benchmarks``
finds it by its name, and puts its figures in the common table. Whatever else it writes is kept.
"""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

__all__ = ["Figure", "busy", "machine", "table", "written"]


@dataclass(frozen=True)
class Figure:
    """One line of the table.

    Attributes
    ----------
    what : str
        What was measured.
    value : float
        In `unit`.
    goal : float, optional
        The most it should be; with `more` true the least.
    peer : float, optional
        What the nearest other program needs for the same, or a plain numpy pass, in the same run.
    peer_name : str
        Who that is.
    bound : float, optional
        What this machine could do at best.
    """

    what: str
    value: float
    unit: str
    goal: float | None = None
    peer: float | None = None
    peer_name: str = ""
    bound: float | None = None
    more: bool = False

    @property
    def ratio(self) -> float | None:
        """How many times the peer's figure is ours."""
        return self.peer / self.value if self.peer is not None and self.value else None

    @property
    def met(self) -> bool | None:
        """Whether the goal is reached; None without one."""
        if self.goal is None:
            return None
        return self.value >= self.goal if self.more else self.value <= self.goal


def busy() -> str:
    """Return what to say of a machine that has other work to do as well; empty if it has not."""
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    if load < 1.5 * cores:
        return ""
    return (
        f"busy machine, load {load:.0f} on {cores} cores: wall times and losses are not ours alone"
    )


def machine() -> dict[str, str]:
    """Return where and with what it was measured."""
    import numpy as np

    return {
        "machine": platform.processor() or platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "busy": busy(),
    }


def all_cpu_s() -> float:
    """Return the processor time of this process, and of those it has started that have ended."""
    return float(sum(os.times()[:4]))


def written(figures: Iterable[Figure], path: Path | None, **more: Any) -> None:
    """Print the figures, and write them and everything else to a file if there is to be one."""
    figures = list(figures)
    print(table([("", figure) for figure in figures]))
    print(busy())
    if path is not None:
        content = {"machine": machine(), "figures": [asdict(one) for one in figures], **more}
        path.write_text(json.dumps(content, indent=1, default=float) + "\n")


def table(rows: Iterable[tuple[str, Figure]]) -> str:
    """Return lines of (benchmark, figure) as text in columns."""
    head = ("benchmark", "what", "this", "unit", "peer", "ratio", "goal", "bound", "")
    cells = [head]
    for name, one in rows:
        peer = f"{_short(one.peer)} {one.peer_name}".strip()
        goal = ("≥ " if one.more else "≤ ") + _short(one.goal) if one.goal is not None else ""
        met = {True: "met", False: "MISSED", None: ""}[one.met]
        row = (name, one.what, _short(one.value), one.unit, peer, _short(one.ratio), goal)
        cells.append((*row, _short(one.bound), met))
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    )


def _short(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}" if abs(value) < 1e4 else f"{value:.0f}"
