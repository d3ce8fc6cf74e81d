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

from allanscope.explain.adequacy import CONSTANT_P, SPECTRAL, WITHIN, adequate, is_measured
from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.drift_audit import audit_drift
from allanscope.explain.effects import KINDS
from allanscope.explain.effects.base import EffectKind
from allanscope.explain.effects.unexplained import (
    covered,
    is_remnant,
    tones_left_over,
    united,
)
from allanscope.explain.jointly import refit_jointly
from allanscope.explain.ledger import Ledger
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
_THERMAL = ("warm_up", "temperature")
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
    acceptances, evaluations : int
        Most effects that are accepted, whether they stay or not, and most fits of one kind to the
        whole record: a search that goes round is stopped, after a time linear in the rows.
    spent_nats : float
        What earlier looks at the same data cost, added to every price.
    """

    effects: int = 14
    passes: int = 2
    acceptances: int = 20
    evaluations: int = 600
    kinds: frozenset[str] | None = None
    spent_nats: float = 0.0


def close_loop(view: View, budget: Budget | None = None) -> View:
    """Return the view with every effect that was accepted."""
    budget = budget or Budget()
    ledger = Ledger(budget.acceptances, budget.evaluations)
    settled: dict[int, View] = {}
    for _ in range(budget.passes):
        before = len(view.accepted)
        for stage in sorted({kind.stage for kind in KINDS.values()}):
            if settled.get(stage) is view:
                continue  # nothing has changed since: it would find nothing again
            view = settled[stage] = _settle(view, stage, budget, ledger)
            if stage == 2 and (audited := audit_drift(view)) is not view:
                view = _settled(audited, ledger)
        if len(view.accepted) == before or ledger.is_spent:
            break
    return replace(view, stopped=ledger.remark)


def _settled(view: View, ledger: Ledger) -> View:
    """Return the view with every effect estimated given the others, and only those that pay."""
    return _delete(refit_jointly(_refit(view, ledger)), ledger)


def _settle(view: View, stage: int, budget: Budget, ledger: Ledger) -> View:
    kinds = [
        kind
        for kind in KINDS.values()
        if kind.stage == stage
        and kind.available(view)
        and (budget.kinds is None or kind.kind in budget.kinds)
    ]
    former: list[Candidate] = []
    # What is left over is reported even when the search for names was stopped.
    while len(view.accepted) < budget.effects and (stage > 2 or not ledger.is_spent):
        candidates = list(_proposals(view, kinds, ledger))
        if former:
            view = _with_rivals(view, former, candidates)
        if stage == 2:
            pair = _thermal_pair(view, kinds, candidates, budget.spent_nats, ledger)
            if pair is not None:
                view, former = _settled(pair, ledger), []
                continue
        accepted = _best(view, candidates, budget.spent_nats)
        if accepted is None:
            together = None
            if stage == 2:
                together = _bundle(view, kinds, candidates, budget.spent_nats, ledger)
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
        ledger.acceptances += 1
        if accepted.kind == "unexplained" and stage == 2:
            view, accepted = united(view, accepted)
        view = _demodulated(view.accept(accepted))
        if stage >= 2:
            view = _settled(view, ledger)
    return view


def _proposals(view: View, kinds: Iterable[EffectKind], ledger: Ledger) -> Iterable[Candidate]:
    """Ask kinds for candidates, but for those that were taken before and dropped."""
    for kind in kinds:
        ledger.evaluations += 1
        for candidate in kind.propose(view):
            if not ledger.was_dropped(candidate, view.grid):
                yield candidate


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
        if held is not None and _is_refuted(verdict, held):
            continue
        return replace(verdict, held_out=held)
    return None


def _is_refuted(candidate: Candidate, held: HeldOut) -> bool:
    """Tell whether quarters disagree on the slope: something else that is slow."""
    return candidate.kind == "temperature" and held.replicated is False


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


def _thermal_pair(
    view: View,
    kinds: list[EffectKind],
    candidates: list[Candidate],
    before: float,
    ledger: Ledger,
) -> View | None:
    """Return the view with a warm-up and the temperature, if the two pass in one regression.

    Each, fitted alone, takes along what belongs to the other, and a slope that was found beside
    half a warm-up is refuted by the quarter in which the warm-up was.
    """
    missing = [kind for kind in kinds if kind.kind in _THERMAL and not view.has(kind.kind)]
    promising = [c for c in candidates if c.kind in _THERMAL and c.excess > before]
    if not missing or not promising or not all(view.has(k) for k in _others(missing)):
        return None
    trial, first = view.accept(max(promising, key=lambda c: c.excess)), len(view.accepted)
    rest = [kind for kind in missing if not trial.has(kind.kind)]
    for candidate in list(_proposals(trial, rest, ledger)):
        trial = trial.accept(candidate)
    if not all(trial.has(kind) for kind in _THERMAL):
        return None
    trial = refit_jointly(trial)
    members = tuple(c for c in trial.accepted if c.kind in _THERMAL)
    excess = trial.spectrum.loglik - view.spectrum.loglik - before - _owed(trial, first)
    others = max((c.excess for c in candidates if c.kind not in _THERMAL), default=0.0)
    if excess <= max(0.0, others - before) or any(c.excess <= before for c in members):
        return None
    pair = _held(trial, members)
    if pair is not None:
        ledger.acceptances += len(trial.accepted) - first
    return pair


def _others(missing: list[EffectKind]) -> set[str]:
    """Return which of the pair must have been accepted already."""
    return set(_THERMAL) - {kind.kind for kind in missing}


def _bundle(
    view: View,
    kinds: list[EffectKind],
    candidates: list[Candidate],
    before: float,
    ledger: Ledger,
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
            candidates = list(_proposals(trial, slow, ledger))
        slowly = [c for c in candidates if c.kind in _SLOWLY and not is_remnant(trial, c)]
        promising = [c for c in slowly if c.gain > _PROMISING]
        if not promising:
            return None
        trial = trial.accept(max(promising, key=lambda c: c.excess))
        missing = before + _owed(trial, first) - (trial.spectrum.loglik - view.spectrum.loglik)
        if missing > _HOPELESS:
            return None
        if len(trial.accepted) - first > 1 and missing < _NEARLY:
            trial = refit_jointly(_refit(trial, ledger))
            gain = trial.spectrum.loglik - view.spectrum.loglik
            members = trial.accepted[first:]
            if gain > before + _owed(trial, first) and all(c.excess > 0 for c in members):
                ledger.acceptances += len(members)
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
        if held is not None and (held.nats <= 0 or _is_refuted(candidate, held)):
            return None
        judged.append(replace(candidate, held_out=held))
    return replace(view, accepted=tuple(judged))


def _refit(view: View, ledger: Ledger) -> View:
    """Estimate every effect again, given the others."""
    if len([c for c in view.accepted if KINDS[c.kind].stage == 2 or c.is_drift]) < 2:
        return view
    for candidate in view.accepted:
        if KINDS[candidate.kind].stage != 2:
            continue
        ledger.evaluations += 1
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


def _delete(view: View, ledger: Ledger) -> View:
    """Drop effects that the later ones have made superfluous, or that have no size beside them."""
    last = view.accepted[-1:]
    for candidate in view.accepted:
        if KINDS[candidate.kind].stage != 2 or candidate.kind == "unexplained":
            continue
        superfluous = candidate.gain < candidate.price and all(candidate is not c for c in last)
        if superfluous or not is_measured(candidate):
            _LOG.debug("%s drops %s", view.axis, candidate.kind)
            view = view.without(candidate)
            ledger.drop(candidate)
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
