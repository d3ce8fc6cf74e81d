"""What a search has taken and dropped: it takes nothing twice, and it ends.

Where no kind fits, a search can go round: one band is accepted, the next two make it superfluous,
without it they no longer hold, and it is found again. Acceptances and evaluations are counted, not
seconds, so that the same record has the same result on every machine; as an evaluation costs a few
transforms, the bound on the time is linear in the rows.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from allanscope.explain.candidate import Candidate
from allanscope.explain.grid import Grid

__all__ = ["Ledger"]

_ALIKE = 1.5
"""Ratio up to which two time constants or cutoffs are the same."""
_AT_A_PLACE = ("sinusoid", "narrowband", "step", "excursion")
_OF_A_SCALE = ("warm_up", "gauss_markov", "random_telegraph")
_NEAR_S = 5.0
"""Distance in time up to which two jumps are the same."""


@dataclass
class Ledger:
    """Count what one search does.

    Attributes
    ----------
    most_acceptances, most_evaluations : int
        Bounds; an evaluation is one kind asked for candidates, or one effect estimated again.
    acceptances, evaluations : int
        Counted so far.
    """

    most_acceptances: int
    most_evaluations: int
    acceptances: int = 0
    evaluations: int = 0
    _dropped: list[Candidate] = field(default_factory=list)

    @property
    def is_spent(self) -> bool:
        """Whether the search must stop."""
        return (
            self.acceptances >= self.most_acceptances or self.evaluations >= self.most_evaluations
        )

    @property
    def remark(self) -> str:
        """What the reader must know of a search that was stopped; empty otherwise."""
        if not self.is_spent:
            return ""
        return (
            f"the search was stopped after {self.acceptances} effects had been tried and "
            f"{self.evaluations} fits: no set of effects describes this axis, and what is named "
            "may be pieces of something else"
        )

    def drop(self, candidate: Candidate) -> None:
        """Note that an effect was taken and then found superfluous."""
        self._dropped.append(candidate)

    def was_dropped(self, candidate: Candidate, grid: Grid) -> bool:
        """Tell whether this hypothesis was taken before and dropped."""
        return any(_is_same(candidate, former, grid) for former in self._dropped)


def _is_same(first: Candidate, second: Candidate, grid: Grid) -> bool:
    if first.kind != second.kind:
        return False
    if first.kind == "cross_coupling":
        return first.parameters["source"].value == second.parameters["source"].value
    if first.kind in _AT_A_PLACE:
        a, b = first.shape, second.shape
        near = {
            "sinusoid": grid.rate_hz / grid.n,
            "narrowband": min(a[-1], b[-1]) / 2,
        }.get(first.kind, _NEAR_S * grid.rate_hz)
        return abs(a[0] - b[0]) < near
    if first.kind in _OF_A_SCALE:
        ratio = first.shape[-1] / second.shape[-1]
        return 1 / _ALIKE < ratio < _ALIKE
    return True
