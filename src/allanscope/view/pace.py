"""When a result is worth keeping: results are spaced evenly in the logarithm of time.

A curve after 1 h and one after 1 h and 1 s look the same, one after 1 s and one after 2 s do not.
A result is drawn when the run has grown by `SHARE` since the last one, but not more often than
once a second of the run and not less often than once a minute: some 1100 in twelve hours, which
can be scrubbed through like a film.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Pace"]

SHARE = 0.01
SHORTEST_S = 1.0
LONGEST_S = 60.0


@dataclass(slots=True)
class Pace:
    """Says which results to keep.

    Attributes
    ----------
    stretch : float
        Multiplies every spacing, for what is needed less often.

    Examples
    --------
    >>> pace = Pace()
    >>> [t for t in (1.0, 1.5, 2.0, 1000.0, 1009.0, 1011.0) if pace.due(t)]
    [1.0, 2.0, 1000.0, 1011.0]
    """

    stretch: float = 1.0
    _last_s: float | None = None

    def due(self, elapsed_s: float) -> bool:
        """Tell whether to keep the result after this much of the run; if so, remember it."""
        last = self._last_s
        if last is not None and last <= elapsed_s:
            spacing = self.stretch * min(max(SHARE * last, SHORTEST_S), LONGEST_S)
            if elapsed_s - last < spacing * (1.0 - 1e-9):
                return False
        self._last_s = elapsed_s
        return True
