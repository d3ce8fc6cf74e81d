"""A proposal of an effect: what would be added to the model, and what speaks for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.part import Part

if TYPE_CHECKING:
    from allanscope.explain.effects.base import EffectKind

__all__ = ["ALPHA", "Candidate", "HeldOut"]

Array = NDArray[np.float64]

ALPHA = 1e-3
"""Probability of a false alarm that each kind may spend on one axis."""


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
    rivals : mapping
        Log-likelihood gains of other kinds for the same symptom, in nats.
    held_out : HeldOut or None
        What it gained on other data.
    axes : tuple of str
        Where the same effect is seen.
    seen_in : str
        What showed it where it was not the rows.
    """

    effect: EffectKind
    gain: float
    log_alternatives: float = 0.0
    alpha: float = ALPHA
    is_paid: bool = False
    signal: Array | None = field(default=None, repr=False)
    parts: tuple[Part, ...] = ()
    excluded: tuple[tuple[float, float], ...] = ()
    rivals: Mapping[str, float] = field(default_factory=dict)
    held_out: HeldOut | None = None
    axes: tuple[str, ...] = ()
    seen_in: str = ""

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
    def words(self) -> str:
        """What it is, in a phrase."""
        return self.effect.words + (f", seen in the {self.seen_in}" if self.seen_in else "")

    @property
    def equivalent(self) -> tuple[str, ...]:
        """Kinds that come within 3 nats: this record cannot rule them out."""
        return tuple(k for k, g in self.rivals.items() if k != self.kind and g > self.gain - 3.0)
