"""The moves of the search: each turns a hypothesis (a `View`) into another, or not.

====================  ==========================================================================
`add`                 the candidate that gains most beyond its penalty and passes the gates
`add_pair`            warm-up and temperature, which take each other's place when fitted alone
`add_beside`          a process that was refused, and what had hidden what it is
`add_bands`           resonances side by side, of which none holds alone, and their low-pass
`add_bundle`          several slow effects that pass together though none passes alone
`add_known_lines`     lines that other axes have, at their frequencies
`refit`               every effect estimated again given the others
`drop`                effects that later ones have made superfluous
`drop_taken_over`     processes that the others take over once they are estimated again
`fold_sidebands`      a carrier and its sidebands become the one modulated tone that they are
`fold_steps`          two opposite steps become the one excursion that they are
`give_back`           bursts and outliers that a coupling explains, which is found after them
`split_bands`         a band becomes the two resonances within each other's width that it is
`replace_drift`       slow effects that are pieces of a drift without a name become `unexplained`
`resolve_tones`       what was left out of the fit becomes the lines that drift in it
`join_flanks`         what is there only while a far louder line is there becomes a part of that
====================  ==========================================================================

What every move tries is noted in a `SearchPath`, which also bounds the search. Where no kind fits,
a search can go round: one band is accepted, the next two make it superfluous, without it they no
longer hold, and it is found again. So nothing that was dropped is taken again, acceptances are
counted, and every stage has so many evaluations; not seconds, so that the same record has the same
result on every machine. As an evaluation costs a few transforms, the bound on the time is linear in
the rows.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import SearchStep
from allanscope.noise.grid import Grid

__all__ = ["SearchPath"]


@dataclass
class SearchPath:
    """What one search has tried.

    Attributes
    ----------
    most_acceptances : int
        Most effects that are accepted, whether they stay or not.
    spent : float
        What earlier looks at the same data cost, in nats, added to every penalty.
    acceptances, evaluations : int
        Counted so far; an evaluation is one kind asked for candidates, or one effect estimated
        again.
    stopped : list of str
        Stages that ended before they were done.
    steps : list of SearchStep
        In the order in which they were tried.
    """

    most_acceptances: int = 20
    spent: float = 0.0
    acceptances: int = 0
    evaluations: int = 0
    stopped: list[str] = field(default_factory=list)
    steps: list[SearchStep] = field(default_factory=list)
    _until: int = sys.maxsize
    _dropped: list[Candidate] = field(default_factory=list)
    _refused: list[tuple[Candidate, int]] = field(default_factory=list)

    def enter(self, evaluations: int) -> None:
        """Begin a stage that has so many evaluations."""
        self._until = self.evaluations + evaluations

    @property
    def is_full(self) -> bool:
        """Whether no more effects may be tried."""
        return self.acceptances >= self.most_acceptances

    @property
    def is_spent(self) -> bool:
        """Whether the stage must end."""
        return self.evaluations >= self._until

    def stop(self, stage: str) -> None:
        """Enter that a stage ends before it is done."""
        if stage not in self.stopped:
            self.stopped.append(stage)

    @property
    def remark(self) -> str:
        """What the reader must know of a search that was stopped; empty otherwise."""
        if not self.stopped:
            return ""
        return (
            f"the search was stopped ({', '.join(self.stopped)}) after {self.acceptances} effects "
            f"had been tried and {self.evaluations} fits: no set of effects describes this axis, "
            "and the named ones may be fragments of another"
        )

    def note(self, move: str, candidate: Candidate, outcome: str) -> None:
        """Enter what became of a candidate."""
        self.steps.append(
            SearchStep(
                move,
                candidate.kind,
                candidate.words,
                float(candidate.gain),
                float(candidate.penalty),
                outcome,
            )
        )

    def accept(self, move: str, *candidates: Candidate) -> None:
        """Enter effects that were accepted."""
        self.acceptances += len(candidates)
        for candidate in candidates:
            self.note(move, candidate, "accepted")

    def drop(self, candidate: Candidate) -> None:
        """Enter that an effect was taken and then found superfluous."""
        self.note("drop", candidate, "gains less than its penalty beside the others")
        self._dropped.append(candidate)

    def was_dropped(self, candidate: Candidate, grid: Grid) -> bool:
        """Return whether this hypothesis was taken before and dropped."""
        return any(_is_same(candidate, former, grid) for former in self._dropped)

    def refuse(self, candidate: Candidate, beside: int) -> None:
        """Enter that nothing makes a hypothesis hold beside so many others."""
        self._refused.append((candidate, beside))

    def was_refused(self, candidate: Candidate, beside: int, grid: Grid) -> bool:
        """Return whether this hypothesis was refused beside as many."""
        return any(
            beside == count and _is_same(candidate, former, grid) for former, count in self._refused
        )


def _is_same(candidate: Candidate, former: Candidate, grid: Grid) -> bool:
    is_kind = candidate.kind == former.kind
    return is_kind and candidate.finished().effect.is_same(former.finished().effect, grid)
