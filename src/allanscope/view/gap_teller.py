"""Tells of gaps without flooding: a bad link may have hundreds in a second."""

from __future__ import annotations

from dataclasses import dataclass

from allanscope.quantities import count
from allanscope.samples import Gap

__all__ = ["GapTeller"]

_APART_S = 1.0


@dataclass(slots=True)
class GapTeller:
    """Says one line for a gap, and none for those that follow within a second.

    Examples
    --------
    >>> teller = GapTeller()
    >>> teller.tell(Gap("link", 27), 10.0)
    'gap (link): 27 samples lost'
    >>> teller.tell(Gap("link", 54), 10.1)
    >>> teller.tell(Gap("disconnected", None), 20.0)
    'gap (disconnected): length unknown; 1 more since the last'
    """

    _last_s: float | None = None
    _untold: int = 0

    def tell(self, gap: Gap, now_s: float) -> str | None:
        """Return what to say about a gap at time `now_s`, None to say nothing."""
        if self._last_s is not None and now_s - self._last_s < _APART_S:
            self._untold += 1
            return None
        lost = "length unknown" if gap.lost is None else f"{count(gap.lost)} samples lost"
        more = f"; {self._untold} more since the last" if self._untold else ""
        self._last_s, self._untold = now_s, 0
        return f"gap ({gap.reason}): {lost}{more}"
