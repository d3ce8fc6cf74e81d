"""What a candidate must pass before it is accepted; each gate returns why not, or nothing.

1. *penalty*: the gain exceeds what the search for it costs, to which each effect that was accepted
   before adds ln 2 (alpha / 2^k is left to spend);
2. *adequacy*: it is what its name says, or `unexplained` in its place (`adequate`);
3. *held out*: on data that was not used to fit it, it gains more than the standard error of that
   gain; of a large gain of a process at least a quarter, else it did not recur; and where a slope
   must be the same in every quarter, it is;
4. *error*: with everything accepted and the final model fitted, neither chi-square nor worst band
   nor rms is larger than the textbook model leaves, beyond sampling; effects that make it so are
   refused after all (`moves.drop.refuse`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import ResidualError
from allanscope.explain.effects import KINDS
from allanscope.explain.regression import ordinates_of
from allanscope.explain.view import View

__all__ = [
    "adequate",
    "growth",
    "growth_remarks",
    "is_measured",
    "judge",
    "judge_as_named",
    "judge_members",
    "penalties",
    "penalty_passed",
    "refused",
]

_RECURRING, _SMALL = 0.25, 30.0
"""Share of the gain of a process, beyond so many nats, that must be gained again on held-out
data."""
_SAME = 1.02
"""Ratio up to which two errors are the same."""
_ALIKE, _AGAINST = 9, 5.0
"""Ordinates over which power that is left out is averaged, and nats that speak against a signal."""
_OF_CURVE = "rms over averaging times"
_LEAST_CHI2, _LEAST_Z, _LEAST_RMS = 2.0, 4.0, 2.0
"""Chi-square per degree of freedom, z of the worst of so many bands, and rms over that which
sampling leaves on average, up to which an error may be sampling: the rms of three independent
averaging times is beyond once in 130 (Pearson's chi-square)."""


def penalty_passed(view: View, candidate: Candidate, spent: float) -> bool:
    """Return whether a candidate gains more than its search and those before it cost."""
    accepted = [c for c in view.accepted if not c.effect.is_coefficient]
    return bool(candidate.excess > spent + len(accepted) * np.log(2))


def judge(view: View, candidate: Candidate) -> tuple[Candidate | None, str]:
    """Return what may be accepted in the place of a candidate, or None, and the gate that said so.

    The penalty is not asked here.
    """
    verdict = adequate(view, candidate)
    if verdict is None:
        return None, "adequacy: the data are not of this kind"
    if why := _superfluous(view, verdict):
        return None, f"adequacy: {why}"
    held = verdict.effect.hold_out(view, verdict)
    recurring = _RECURRING * (verdict.gain - _SMALL) if verdict.effect.is_process else 0.0
    if held is not None and held.nats <= max(held.error, recurring):
        return None, f"held out: log-likelihood gain {held.nats:.1f} on held-out data"
    if held is not None and _is_refuted(verdict, held):
        return None, "held out: quarters of the record disagree"
    return replace(verdict, held_out=held), "accepted"


def judge_as_named(view: View, candidate: Candidate) -> tuple[Candidate | None, str]:
    """Return the same; None as well where the candidate would be accepted under another name."""
    accepted, why = judge(view, candidate)
    if accepted is not None and accepted.kind != candidate.kind:
        return None, f"adequacy: it is {accepted.kind}"
    return accepted, why


def _superfluous(view: View, verdict: Candidate) -> str:
    """Return why what was accepted already leaves a verdict no place; empty where it does."""
    if not verdict.effect.is_resolved(view):
        return "the range is explained already"
    if view.leaves_too_little(verdict):
        return "nothing would be left to fit"
    return refused(view, verdict)


def refused(view: View, candidate: Candidate) -> str:
    """Return why an effect that was accepted leaves a candidate no place; empty where none does."""
    if _adds_where_nothing_is_fitted(view, candidate):
        return "the frequencies that are left out do not have it"
    reasons = (c.effect.refuses(view, c, candidate) for c in view.accepted)
    return next(filter(None, reasons), "")


def _adds_where_nothing_is_fitted(view: View, candidate: Candidate) -> bool:
    """Return whether the ranges that are left out of the fit speak against a signal.

    What is slow and has no name is cut out together with the level. A step is fitted then to its
    edge alone, whatever the level does. Where the power is that of a tone, it says little.
    """
    if candidate.signal is None or not (candidate.effect.is_slow and view.excluded):
        return False
    out = ~view.grid.kept(view.excluded)
    signal, data = ordinates_of(candidate.signal)[out], view.ordinates[out]
    power = np.maximum(uniform_filter1d(data**2, _ALIKE), view.spectrum.ordinates[out])
    return bool(0.5 * np.sum(signal * (signal - 2 * data) / power) > _AGAINST)


def judge_members(view: View, members: tuple[Candidate, ...]) -> View | None:
    """Judge every member of a bundle on held-out data, given the others; None if one fails."""
    judged = []
    for candidate in view.accepted:
        if all(candidate is not c for c in members):
            judged.append(candidate)
            continue
        held = candidate.effect.hold_out(view.without(candidate), candidate)
        if held is not None and (held.nats <= held.error or _is_refuted(candidate, held)):
            return None
        judged.append(replace(candidate, held_out=held))
    return view.relisted(judged)


def penalties(view: View, first: int) -> float:
    """Return the penalty of everything accepted after the first so many effects."""
    return float(sum(c.penalty for c in view.accepted[first:]) + first * np.log(2))


def _is_refuted(candidate: Candidate, held: HeldOut) -> bool:
    return candidate.effect.must_replicate and held.replicated is False


def adequate(view: View, candidate: Candidate) -> Candidate | None:
    """Return the candidate, `unexplained` in its place, or None.

    A band whose form is not that of the data has no numbers, and may still be a tone without a
    name.
    """
    if not candidate.effect.is_resolved(view):
        return None
    measured = is_measured(candidate)
    if measured:
        others = (kind.instead_of(view, candidate) for kind in KINDS.values())
        better = next((one for one in others if one is not None), None)
        if better is not None:
            return better
    found = candidate.effect.adequate(view, candidate)
    return found if found is None or measured or not found.effect.is_named else None


def is_measured(candidate: Candidate) -> bool:
    """Return whether every number has an interval that is one: finite, and wider than nothing.

    Without it the likelihood has no maximum there in some direction, so nothing has been measured.
    Counts and instants may be known exactly.
    """
    effect = candidate.effect
    return not (effect.is_process or effect.is_fitted) or all(
        p.lower is not None and p.upper is not None and p.lower < p.upper < np.inf
        for p in effect.parameters.values()
    )


def growth(before: ResidualError, after: ResidualError) -> tuple[float, str]:
    """Return by which factor the error has grown most, as a logarithm, and in words.

    At most 0, and no words, where no error is larger than before beyond sampling. The rms over
    averaging times is for the most part that of the few longest, which scatter.
    """
    pairs = (
        ("chi-square per degree of freedom", before.chi2_per_dof, after.chi2_per_dof, _LEAST_CHI2),
        ("worst band", abs(before.worst_band_z), abs(after.worst_band_z), _LEAST_Z),
        (
            _OF_CURVE,
            before.rms_percent,
            after.rms_percent,
            _LEAST_RMS * after.expected_rms_percent,
        ),
    )
    worst, why = 0.0, ""
    for name, first, second, least in pairs:
        allowed = _SAME * max(first, least)
        if second > allowed and np.log(second / allowed) > worst:
            worst = float(np.log(second / allowed))
            why = f"error: {name} grows from {first:.3g} to {second:.3g}"
    return worst, why


def growth_remarks(before: ResidualError, after: ResidualError) -> tuple[str, ...]:
    """Return what must be said where an error is larger and no effect is to blame.

    Of the rms whatever is more than before, and more than sampling leaves on average.
    """
    why, out = growth(before, after)[1].removeprefix("error: "), []
    if why and not why.startswith(_OF_CURVE):
        out.append(
            f"{why}: the residual is compared with the smaller sampling error of the better model"
        )
    if after.rms_percent > _SAME * max(before.rms_percent, after.expected_rms_percent):
        out.append(
            f"{_OF_CURVE} grows from {before.rms_percent:.3g} to {after.rms_percent:.3g} %; "
            f"sampling error alone leaves {after.expected_rms_percent:.3g} %"
        )
    return tuple(out)
