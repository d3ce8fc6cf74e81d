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

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects import KINDS
from allanscope.explain.effects.base import EffectKind
from allanscope.explain.effects.unexplained import (
    DEGREE,
    RELAXATIONS,
    beside,
    covered,
    drift_left_over,
    is_remnant,
    relaxation_left_over,
    tone_left_over,
    tones_left_over,
    united,
)
from allanscope.explain.residual import band_scores
from allanscope.explain.tones import evenness, sidebands, sweeps, unsteadiness
from allanscope.explain.view import View

__all__ = ["Budget", "close_loop"]

Array = NDArray[np.float64]
_LOG = logging.getLogger(__name__)

_SPECTRAL = ("gauss_markov", "narrowband", "band_limit", "Q")
_CONSTANT_P = 1e-5
_FEWEST_COHERENCES = 12.0
"""Fewer coherence times in a record cannot show that a band holds noise."""
_UNSTEADY = 6.0
"""Sigma; noise in bands of any width stayed below 2 in some hundred records."""
_TOO_EVEN, _MISSHAPEN, _MISSED = 5.0, 6.0, 0.02
"""Sigma of the envelope; sigma and share of the gain of what a band leaves: beyond all three it is
a tone whose frequency moves."""
_SUB_BANDS = 64
_WITHIN = 3.0
_GOOD_PART = 0.3
"""Distance in bandwidths and share of the gain of a line that may be all there is to a band."""
_SIMILAR = 3.0
_HELD_SHARE, _SMALL = 0.25, 30.0
"""Of a large gain at least a quarter must be found on held-out data: else it did not recur."""
_SLOW = ("warm_up", "ramp", "temperature")
_CLEARLY = 5.0
_UNFINISHED = 0.3
"""Share of the gain of the named effects that a polynomial may still find behind them."""
_FEW_WAVES = 4.0
"""A slower line may be a piece of something else."""
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
            if stage == 2:
                view = _audit_drift(view)
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
        view = _demodulated(accept(view, accepted))
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
        verdict = _adequate(view, candidate)
        if verdict is None or covered(view, verdict) or is_remnant(view, verdict):
            continue
        held = KINDS[verdict.kind].hold_out(view, verdict)
        recurring = _HELD_SHARE * (verdict.gain - _SMALL) if verdict.kind in _SPECTRAL else 0.0
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
            and abs(c.shape[0] - f0) < _WITHIN * width
            and c.excess > _GOOD_PART * band.excess
            and c.evidence["constancy_p"] > _CONSTANT_P
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
        promising = [c for c in candidates if c.kind in _SLOWLY and c.gain > _PROMISING]
        if not promising:
            return None
        trial = accept(trial, max(promising, key=lambda c: c.excess))
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
        held = KINDS[candidate.kind].hold_out(without(view, candidate), candidate)
        if held is not None and held.nats <= 0:
            return None
        judged.append(replace(candidate, held_out=held))
    return replace(view, accepted=tuple(judged))


def _adequate(view: View, candidate: Candidate) -> Candidate | None:
    """Return the candidate, `unexplained` in its place, or None."""
    if candidate.kind in ("sinusoid", "narrowband"):
        return candidate if _is_steady(view, candidate) else tone_left_over(view, candidate)
    if candidate.kind in _SPECTRAL and not _removes(view, candidate):
        return None
    return candidate


def _is_steady(view: View, tone: Candidate) -> bool:
    """Tell whether a line is one line all along, or a band holds noise all along."""
    if beside(view, tone):
        return False
    if tone.kind == "sinusoid":
        return bool(tone.evidence["constancy_p"] >= _CONSTANT_P)
    rate, (f0, width) = view.grid.rate_hz, tone.shape[:2]
    return (
        width * view.series.duration_s >= _FEWEST_COHERENCES
        and unsteadiness(view.data, rate, f0, width) < _UNSTEADY
        and not sweeps(view.data, rate, f0, width)
        and not (evenness(view.data, rate, f0, width) > _TOO_EVEN and _is_misshapen(view, tone))
        and _removes(view, tone)
    )


def _is_misshapen(view: View, band: Candidate) -> bool:
    """Tell whether the spectrum within a band differs from the shape that was fitted."""
    after = view.with_terms(view.terms + band.terms)
    f0, width = band.shape[:2]
    near = np.flatnonzero(np.abs(view.grid.frequency - f0) < _WITHIN * width)
    parts = np.array_split(near, min(_SUB_BANDS, max(1, len(near) // 8)))
    u = after.squares / after.spectrum.ordinates
    ratio = np.array([u[part].mean() for part in parts])
    count = np.array([len(part) for part in parts])
    left = float(np.sum(count * (ratio - 1 - np.log(ratio)) - 1)) / 2
    return bool(left > max(_MISSHAPEN * np.sqrt(len(parts) / 2), _MISSED * band.gain))


def _removes(view: View, candidate: Candidate) -> bool:
    """Tell whether most of the residual is gone where the candidate changes the spectrum most."""
    after = view.with_terms(view.terms + candidate.terms)
    bands = band_scores(view)
    later = band_scores(after)
    change = np.abs(np.log(after.spectrum.at(bands.frequency) / view.spectrum.at(bands.frequency)))
    weight = change * np.sqrt(bands.count)
    own = weight > 0.5 * weight.max()
    if not own.any():
        return False
    first = float(np.sqrt(np.mean(bands.z[own] ** 2)))
    second = float(np.sqrt(np.mean(later.z[own] ** 2)))
    return second < max(3.0, 0.5 * first)


def accept(view: View, candidate: Candidate) -> View:
    """Return the view with one more effect."""
    data = view.data if candidate.signal is None else view.data - candidate.signal
    return replace(
        view,
        data=data,
        terms=view.terms + candidate.terms,
        accepted=(*view.accepted, candidate),
    )


def without(view: View, candidate: Candidate) -> View:
    """Return the view without one of its effects."""
    data = view.data if candidate.signal is None else view.data + candidate.signal
    return replace(
        view,
        data=data,
        terms=tuple(t for t in view.terms if t not in candidate.terms),
        accepted=tuple(c for c in view.accepted if c is not candidate),
    )


def _refit(view: View) -> View:
    """Estimate every effect again, given the others."""
    if len([c for c in view.accepted if KINDS[c.kind].stage == 2]) < 2:
        return view
    for candidate in view.accepted:
        if KINDS[candidate.kind].stage != 2:
            continue
        bare = without(view, candidate)
        again = KINDS[candidate.kind].refine(bare, candidate)
        again = replace(again, held_out=candidate.held_out, rivals=candidate.rivals)
        grown = accept(bare, again)
        order = [again if c is candidate else c for c in view.accepted]
        view = replace(grown, accepted=tuple(order))
    return view


def _demodulated(view: View) -> View:
    """Replace a carrier and its two equal sidebands by the one modulated tone that they are."""
    family = sidebands([c for c in view.accepted if c.kind == "sinusoid"])
    if not family:
        return view
    for line in family:
        view = without(view, line)
    view, tone = united(view, tones_left_over(view, family))
    return accept(view, tone)


def _delete(view: View) -> View:
    """Drop effects that the later ones have made superfluous."""
    for candidate in view.accepted[:-1]:
        if KINDS[candidate.kind].stage != 2 or candidate.kind == "unexplained":
            continue
        if candidate.gain < candidate.price:
            _LOG.debug("%s drops %s", view.axis, candidate.kind)
            view = without(view, candidate)
    return view


def _audit_drift(view: View) -> View:
    """Replace slow effects by `unexplained` where a free polynomial does clearly better than they.

    A drift of any other form is fitted piecewise by exponentials and ramps; each piece is
    significant and none is true.
    """
    view = _audit_relaxation(view)
    duration = view.series.duration_s
    slow = [
        c
        for c in view.accepted
        if c.kind in _SLOW or (c.kind == "sinusoid" and c.shape[0] * duration < _FEW_WAVES)
    ]
    if not slow:
        return view
    bare = view
    for candidate in slow:
        bare = without(bare, candidate)
    named = view.spectrum.loglik - bare.spectrum.loglik
    free, rest = drift_left_over(bare), drift_left_over(view)
    if free is None:
        return view
    better = free.gain - DEGREE > named + _CLEARLY
    unfinished = rest is not None and rest.gain > _UNFINISHED * named
    return accept(bare, free) if better or unfinished else view


def _audit_relaxation(view: View) -> View:
    """Replace a warm-up by `unexplained` where several exponentials do clearly better than one."""
    warm = next((c for c in view.accepted if c.kind == "warm_up"), None)
    if warm is None:
        return view
    bare = without(view, warm)
    free = relaxation_left_over(bare, warm.shape[0])
    named = view.spectrum.loglik - bare.spectrum.loglik
    better = free.gain - len(RELAXATIONS) > named + _CLEARLY
    return accept(bare, free) if better else view


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
