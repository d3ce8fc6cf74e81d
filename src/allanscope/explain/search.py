"""The search: one effect at a time, each judged with the noise refitted, until nothing passes.

Every iteration asks all kinds of the current stage for candidates. The one that gains most beyond
the price of its search is taken, if

- its gain exceeds the price, to which each iteration adds ln 2 (alpha / 2^k is left to spend);
- it gains on data that was not used to fit it (`heldout`);
- it is adequate: it removes most of the residual where it claims to act, a tone is one tone all
  along, a band's envelope is that of noise. What triggers but is not adequate is unexplained.

Then all accepted effects are estimated again given the others, and each is tested by deletion.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.adequacy import CONSTANT_P, SPECTRAL, WITHIN, adequate
from allanscope.explain.candidate import Candidate
from allanscope.explain.drift_audit import audit_drift
from allanscope.explain.effects import KINDS
from allanscope.explain.effects.base import EffectKind
from allanscope.explain.effects.unexplained import (
    covered,
    is_remnant,
    tones_left_over,
    united,
)
from allanscope.explain.tones import sidebands
from allanscope.explain.view import View

__all__ = ["Budget", "close_loop"]

Array = NDArray[np.float64]
_LOG = logging.getLogger(__name__)

_GOOD_PART = 0.3
"""Share of a band's gain that a line may have which is all there is to the band."""
_SIMILAR = 3.0
_HELD_SHARE, _SMALL = 0.25, 30.0
"""Of a large gain at least a quarter must be found on held-out data: else it did not recur."""
_SLOWLY = ("warm_up", "ramp", "step", "excursion", "temperature")
_BUNDLE = 6
_HOPELESS, _NEARLY = 30.0, 8.0
"""Nats that may be missing for a bundle to be continued, and to be fitted in earnest."""
_PROMISING = 5.0
"""Gain in nats below which nothing is worth looking behind."""


@dataclass(frozen=True, slots=True)
class Budget:
    """How far the loop may go.

    Attributes
    ----------
    effects : int
        Most effects on one axis.
    passes : int
        Most rounds through the stages.
    kinds : frozenset of str or None
        Only these kinds are asked; None for all.
    spent_nats : float
        What earlier looks at the same data cost, added to every price.
    """

    effects: int = 14
    passes: int = 2
    kinds: frozenset[str] | None = None
    spent_nats: float = 0.0


def close_loop(view: View, budget: Budget | None = None) -> View:
    """Return the view with every effect that was accepted."""
    budget = budget or Budget()
    settled: dict[int, View] = {}
    for _ in range(budget.passes):
        before = len(view.accepted)
        for stage in sorted({kind.stage for kind in KINDS.values()}):
            if settled.get(stage) is view:
                continue  # nothing has changed since: it would find nothing again
            view = settled[stage] = _settle(view, stage, budget)
            if stage == 2 and (audited := audit_drift(view)) is not view:
                view = _delete(_refit(audited))
        if len(view.accepted) == before:
            break
    return view


def _settle(view: View, stage: int, budget: Budget) -> View:
    kinds = [
        kind
        for kind in KINDS.values()
        if kind.stage == stage
        and kind.available(view)
        and (budget.kinds is None or kind.kind in budget.kinds)
    ]
    former: list[Candidate] = []
    while len(view.accepted) < budget.effects:
        candidates = list(_proposals(view, kinds))
        if former:
            view = _with_rivals(view, former, candidates)
        accepted = _best(view, candidates, budget.spent_nats)
        if accepted is None:
            together = _bundle(view, kinds, candidates, budget.spent_nats) if stage == 2 else None
            if together is None:
                break
            view, former = together, []
            continue
        _LOG.debug(
            "%s accepts %s %s gain %.1f",
            view.axis,
            accepted.kind,
            accepted.shape[:3],
            accepted.gain,
        )
        former = candidates
        if accepted.kind == "unexplained" and stage == 2:
            view, accepted = united(view, accepted)
        view = _demodulated(view.accept(accepted))
        if stage >= 2:
            view = _delete(_refit(view))
    return view


def _proposals(view: View, kinds: Iterable[EffectKind]) -> Iterable[Candidate]:
    for kind in kinds:
        yield from kind.propose(view)


def _best(view: View, candidates: list[Candidate], before: float) -> Candidate | None:
    """Return the first candidate, by what it gains beyond its price, that stands every test."""
    spent = before + len([c for c in view.accepted if c.kind != "ramp"]) * np.log(2)
    for candidate in _ranked(candidates):
        if candidate.excess <= spent:
            return None
        verdict = adequate(view, candidate)
        if verdict is None or covered(view, verdict) or is_remnant(view, verdict):
            continue
        held = KINDS[verdict.kind].hold_out(view, verdict)
        recurring = _HELD_SHARE * (verdict.gain - _SMALL) if verdict.kind in SPECTRAL else 0.0
        if held is not None and held.nats <= max(0.0, recurring):
            continue
        if verdict.kind == "temperature" and held is not None and held.replicated is False:
            continue  # something else that is slow: the slope must be the same in every quarter
        return replace(verdict, held_out=held)
    return None


def _ranked(candidates: list[Candidate]) -> list[Candidate]:
    """Order candidates by what they gain beyond their price.

    A constant line that holds a good part of the power of a band goes before the band: a few lines
    side by side are lines, and so are those of a modulated tone.
    """
    ranked = sorted(candidates, key=lambda c: -c.excess)
    for band in [c for c in ranked if c.kind == "narrowband"]:
        f0, width = band.shape[:2]
        lines = [
            c
            for c in ranked
            if c.kind == "sinusoid"
            and abs(c.shape[0] - f0) < WITHIN * width
            and c.excess > _GOOD_PART * band.excess
            and c.evidence["constancy_p"] > CONSTANT_P
        ]
        if lines and band.excess > 0:
            ranked.remove(lines[0])
            ranked.insert(ranked.index(band), lines[0])
    return ranked


def _bundle(
    view: View, kinds: list[EffectKind], candidates: list[Candidate], before: float
) -> View | None:
    """Return the view with several slow effects that pass together, though none passes alone.

    While one of them is left out it keeps K high, and a high K hides the others: a warm-up and
    three bumps of the level look like a random walk until all four are taken out. What is looked
    at is paid for by every member, and each must be worth its price given the others.
    """
    slow = [kind for kind in kinds if kind.kind in _SLOWLY]
    first = len(view.accepted)
    trial = view
    for _ in range(_BUNDLE):
        if trial is not view:
            candidates = list(_proposals(trial, slow))
        slowly = [c for c in candidates if c.kind in _SLOWLY and not is_remnant(trial, c)]
        promising = [c for c in slowly if c.gain > _PROMISING]
        if not promising:
            return None
        trial = trial.accept(max(promising, key=lambda c: c.excess))
        missing = before + _owed(trial, first) - (trial.spectrum.loglik - view.spectrum.loglik)
        if missing > _HOPELESS:
            return None
        if len(trial.accepted) - first > 1 and missing < _NEARLY:
            trial = _refit(trial)
            gain = trial.spectrum.loglik - view.spectrum.loglik
            members = trial.accepted[first:]
            if gain > before + _owed(trial, first) and all(c.excess > 0 for c in members):
                return _held(trial, members)
    return None


def _owed(view: View, first: int) -> float:
    """Price of everything accepted after the first so many effects."""
    return float(sum(c.price for c in view.accepted[first:]) + first * np.log(2))


def _held(view: View, members: tuple[Candidate, ...]) -> View | None:
    """Judge every member of a bundle on held-out data, given the others; None if one fails."""
    judged = []
    for candidate in view.accepted:
        if all(candidate is not c for c in members):
            judged.append(candidate)
            continue
        held = KINDS[candidate.kind].hold_out(view.without(candidate), candidate)
        if held is not None and held.nats <= 0:
            return None
        judged.append(replace(candidate, held_out=held))
    return replace(view, accepted=tuple(judged))


def _refit(view: View) -> View:
    """Estimate every effect again, given the others."""
    if len([c for c in view.accepted if KINDS[c.kind].stage == 2 or c.is_drift]) < 2:
        return view
    for candidate in view.accepted:
        if KINDS[candidate.kind].stage != 2:
            continue
        bare = view.without(candidate)
        again = KINDS[candidate.kind].refine(bare, candidate)
        again = replace(again, held_out=candidate.held_out, rivals=candidate.rivals)
        grown = bare.accept(again)
        order = [again if c is candidate else c for c in view.accepted]
        view = replace(grown, accepted=tuple(order))
    return view


def _demodulated(view: View) -> View:
    """Replace a carrier and its two equal sidebands by the one modulated tone that they are."""
    family = sidebands([c for c in view.accepted if c.kind == "sinusoid"])
    if not family:
        return view
    bare = view.without(*family)
    whole = tones_left_over(bare, family)
    if whole is None:
        return view
    bare, tone = united(bare, whole)
    return bare.accept(tone)


def _delete(view: View) -> View:
    """Drop effects that the later ones have made superfluous."""
    for candidate in view.accepted[:-1]:
        if KINDS[candidate.kind].stage != 2 or candidate.kind == "unexplained":
            continue
        if candidate.gain < candidate.price:
            _LOG.debug("%s drops %s", view.axis, candidate.kind)
            view = view.without(candidate)
    return view


def _with_rivals(view: View, former: list[Candidate], now: list[Candidate]) -> View:
    """Note kinds that would have done as well as the effect accepted last, and now gain nothing."""
    if not view.accepted:
        return view
    last = view.accepted[-1]
    rivals = dict(last.rivals)
    for rival in former:
        if rival.kind in (last.kind, "ramp") or rival.gain < last.gain - _SIMILAR:
            continue
        left = max((c.gain for c in now if c.kind == rival.kind), default=0.0)
        if left < 0.5 * rival.gain:
            rivals[rival.kind] = max(rival.gain, rivals.get(rival.kind, 0.0))
    updated = replace(last, rivals=rivals)
    return view.noting((*view.accepted[:-1], updated))
