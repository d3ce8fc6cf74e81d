"""Results as plain lines: a status for a log file, a summary for the end of a command."""

from __future__ import annotations

import io

from rich.console import Console

from allanscope.analysis.result import Analysis
from allanscope.analysis.wording import losses_text, not_measured, rate_text
from allanscope.quantities import COEFFICIENTS, count, duration, number, symbols
from allanscope.view.terminal_screen import Screen
from allanscope.view.trend import Trends

__all__ = ["status_line", "summary_lines"]

_SUMMARY_WIDTH = 160
_SUMMARY_HEIGHT = 1000


def status_line(analysis: Analysis) -> str:
    """Return how a run stands, in one line: time, rate, losses, temperature, N of every axis."""
    parts = [
        f"{duration(analysis.duration_s):>11}  {rate_text(analysis.rate)}",
        f"{count(analysis.samples)} samples",
        f"lost {losses_text(analysis)}",
    ]
    if analysis.temperature:
        parts.append(f"{analysis.temperature['last']:.1f} °C")
    for unit in ("dps", "g"):
        reading = COEFFICIENTS[unit, "N"][0]
        known = [
            f"{name} {number(axis.coefficients['N'].value * reading.factor)}"
            for name, axis in analysis.axes.items()
            if axis.unit == unit and "N" in axis.coefficients
        ]
        if known:
            parts.append(f"N {' '.join(known)} {symbols(reading.unit)}")
    simulated = not_measured(analysis.origin)
    if simulated is not None:
        parts.append(simulated[0].lower())
    return ", ".join(parts)


def summary_lines(analysis: Analysis) -> list[str]:
    """Return the result as the lines that a command prints at its end, without any colour."""
    page = io.StringIO()
    console = Console(
        file=page,
        width=_SUMMARY_WIDTH,
        height=_SUMMARY_HEIGHT,
        color_system=None,
        force_terminal=False,
        legacy_windows=False,
    )
    console.print(Screen(analysis, Trends()))
    return [line.rstrip() for line in page.getvalue().rstrip().splitlines()]
