"""Where a coefficient is heading: compared with what it was when the run was half as long."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from typing import Literal

from allanscope.analysis.result import Analysis

__all__ = ["Direction", "Trends"]

Direction = Literal["up", "down", "settled", ""]

_SHARE = 0.05
"""Values are remembered each time the run has grown by this share."""


@dataclass(slots=True)
class Trends:
    """Remembers the coefficients of one run, log-spaced, some hundred values each."""

    _times: list[float] = field(default_factory=list)
    _values: list[dict[tuple[str, str], float]] = field(default_factory=list)

    def take(self, analysis: Analysis) -> None:
        """Remember a result."""
        if self._times and analysis.duration_s < (1.0 + _SHARE) * self._times[-1]:
            return
        self._times.append(analysis.duration_s)
        self._values.append(
            {
                (name, letter): known.value
                for name, axis in analysis.axes.items()
                for letter, known in axis.coefficients.items()
                if known.detected
            }
        )

    def direction(self, analysis: Analysis, axis: str, letter: str) -> Direction:
        """Return where a coefficient went since the run was half as long; empty if unknown.

        It is settled when it stayed within half of its present interval.
        """
        known = analysis.axes[axis].coefficients.get(letter)
        then = bisect_right(self._times, 0.5 * analysis.duration_s) - 1
        if known is None or not known.detected or then < 0:
            return ""
        before = self._values[then].get((axis, letter))
        if before is None:
            return ""
        if abs(known.value - before) <= 0.5 * (known.upper - known.lower):
            return "settled"
        return "up" if known.value > before else "down"
