"""A proposal of an effect: what would be added to the model, and the evidence for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.effect import Effect, Estimate, Parameter
from allanscope.explain.given_detection import given_detection
from allanscope.labels import kind_name
from allanscope.lazy import once
from allanscope.noise.part import Part

if TYPE_CHECKING:
    from allanscope.explain.effects import EffectKind
    from allanscope.noise.components import LineProfile

__all__ = ["ALPHA", "SIMILAR", "Candidate", "HeldOut", "effect_of"]

Array = NDArray[np.float64]

ALPHA = 1e-3
"""Probability of a false alarm that each kind may spend on one axis."""
SIMILAR = 3.0
"""Nats within which two kinds explain equally well."""


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Log-likelihood gained on data that was not used to fit.

    Attributes
    ----------
    nats, error : float
        Total, and its standard error.
    design : str
        How the data was held out, e.g. ``interleaved blocks of 1 s``.
    replicated : bool or None
        True when independent parts of the record show the same; None where that cannot be asked.
    """

    nats: float
    error: float
    design: str
    replicated: bool | None = None


def error_of_sum(gained: NDArray[np.float64]) -> float:
    """Return the standard error of what blocks gain together, by their scatter; shape (n,)."""
    return float(np.sqrt(len(gained)) * gained.std())


@dataclass(frozen=True)
class Candidate:
    """One effect with everything the loop needs to judge, enter and report it.

    Attributes
    ----------
    effect : EffectKind
        What it is, with its numbers; textbook coefficients that compete are never reported.
    gain : float
        Log-likelihood gained with the noise refitted under both hypotheses, in nats.
    log_alternatives : float
        Log of the number of alternatives that were looked at, 0 for one.
    alpha : float
        Probability of a false alarm among all of them.
    is_paid : bool
        Whether there is no penalty: something else paid for the search already.
    signal : ndarray, shape (n,), or None
        Deterministic part, to be subtracted from the data.
    parts : tuple of Part
        Stationary part: processes and filters, to be added to the model.
    excluded : tuple of (low, high)
        Frequencies in Hz that are left out of the fit.
    profiles : tuple of LineProfile
        What stands in their place in the final model, which leaves nothing out; where there is none
        its remainder does.
    rivals : mapping
        Log-likelihood gains of other kinds for the same symptom, in nats.
    held_out : HeldOut or None
        What it gained on other data.
    axes : tuple of str
        Where the same effect is seen.
    seen_in : str
        What showed it where it was not the rows.
    finish : callable, or None
        Returns effect and signal with what only a candidate that is picked needs (`finished`).
    """

    effect: EffectKind
    gain: float
    log_alternatives: float = 0.0
    alpha: float = ALPHA
    is_paid: bool = False
    signal: Array | None = field(default=None, repr=False)
    parts: tuple[Part, ...] = ()
    excluded: tuple[tuple[float, float], ...] = ()
    profiles: tuple[LineProfile, ...] = ()
    rivals: Mapping[str, float] = field(default_factory=dict)
    held_out: HeldOut | None = None
    axes: tuple[str, ...] = ()
    seen_in: str = ""
    finish: Callable[[], tuple[EffectKind, Array | None]] | None = field(default=None, repr=False)

    def finished(self) -> Candidate:
        """Return it with intervals and signal, which cost more than the gain it is ranked by."""
        return self if self.finish is None else self._finished

    @once
    def _finished(self) -> Candidate:
        assert self.finish is not None
        effect, signal = self.finish()
        return replace(self, effect=effect, signal=signal, finish=None)

    def solved(self, effect: EffectKind, signal: Callable[[], Array]) -> Candidate:
        """Return it with other numbers, and a signal that is made when it is finished."""
        return replace(self, effect=effect, signal=None, finish=lambda: (effect, signal()))

    @property
    def kind(self) -> str:
        """Word of the vocabulary."""
        return self.effect.kind

    @property
    def penalty(self) -> float:
        """What the search cost in nats: a candidate passes when its gain exceeds it."""
        return 0.0 if self.is_paid else self.log_alternatives - float(np.log(self.alpha))

    @property
    def excess(self) -> float:
        """Gain above the penalty: what candidates are ranked by."""
        return self.gain - self.penalty

    @property
    def changes_model(self) -> bool:
        """Whether it changes the spectrum: by a signal, a process, a filter or a line."""
        return bool(self.parts or self.excluded) or self.signal is not None

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return self.effect.words + (f", seen in the {self.seen_in}" if self.seen_in else "")

    @property
    def equivalent(self) -> tuple[str, ...]:
        """Kinds that come within 3 nats: this record cannot rule them out."""
        return tuple(
            k for k, g in self.rivals.items() if k != self.kind and g > self.gain - SIMILAR
        )


def effect_of(candidate: Candidate, axis: str, share: float = math.nan) -> Effect | None:
    """Return the effect for the report, None for what is a coefficient.

    ``share`` is its part of the excess of the axis over sampling error; of what has no name it is a
    parameter as well.

    ``p_value`` is that of the gain, chi-square with two degrees of freedom, times what was looked
    at. What is read off the values, such as their step, has no gain.
    """
    kind = candidate.effect
    if kind.is_coefficient:
        return None
    log_p = candidate.log_alternatives - min(candidate.gain, 700.0)
    p_value = float(np.exp(np.clip(log_p, -700.0, 0.0)))
    evidence: dict[str, Any] = {
        "words": _words(candidate),
        "gain_nats": float(candidate.gain) if np.isfinite(candidate.gain) else None,
        "price_nats": float(candidate.penalty),
        "p_value": p_value,
        "detection_selected": bool(0 < candidate.excess < 10.0),
        **kind.evidence,
    }
    if candidate.equivalent:
        evidence["rivals"] = {k: float(candidate.rivals[k]) for k in candidate.equivalent}
    if candidate.seen_in:
        evidence["seen_in"] = candidate.seen_in
    held = candidate.held_out
    if held is not None:
        evidence |= {
            "held_out_nats": float(held.nats),
            "held_out_nats_se": float(held.error),
            "held_out_design": held.design,
        }
    replicated = held.replicated if held is not None else None
    parameters = {name: _plain(p) for name, p in kind.parameters.items()}
    if not kind.is_named:
        parameters["share"] = Parameter(share)
    evidence["replicated"] = "not replicated" if replicated is None else replicated
    return Effect(
        kind=candidate.kind,
        parameters=parameters,
        equivalent=candidate.equivalent,
        axes=candidate.axes or (axis,),
        evidence=evidence,
        brief=kind.brief,
        curve=kind.curve,
        share=share,
        given_detection=_corrected(candidate) if evidence["detection_selected"] else None,
    )


def _corrected(candidate: Candidate) -> Parameter | None:
    """Return the size given that its gain exceeded the penalty; None where it has no interval."""
    kind = candidate.effect
    if not kind.sized_by:
        return None
    size: Estimate = getattr(kind, kind.sized_by)
    if not (size.value != kind.size_of_none and size.error > 0.0):
        return None
    penalty = candidate.penalty - kind.form_price
    return _plain(given_detection(size, penalty, candidate.gain, kind.size_of_none))


def _plain(parameter: Parameter) -> Parameter:
    if isinstance(parameter.value, str):
        return parameter
    return Parameter(
        float(parameter.value),
        None if parameter.lower is None else float(parameter.lower),
        None if parameter.upper is None else float(parameter.upper),
        parameter.unit,
    )


def _words(candidate: Candidate) -> str:
    words = candidate.words
    if candidate.equivalent:
        words += "; this record cannot rule out " + " or ".join(
            kind_name(kind) for kind in candidate.equivalent
        )
    if candidate.held_out is not None:
        words += (
            f"; held-out log-likelihood gain {candidate.held_out.nats:.1f} ± "
            f"{candidate.held_out.error:.1f}"
        )
    return words
