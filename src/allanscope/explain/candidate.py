"""A proposal of an effect: what would be added to the model, and what speaks for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.effect import Parameter
from allanscope.noise.part import Part

__all__ = ["Candidate", "HeldOut"]

Array = NDArray[np.float64]


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
    kind : str
        Word of the vocabulary; ``ramp`` is the textbook's R and never reported as an effect.
    gain : float
        Log-likelihood gained with the noise refitted under both hypotheses, in nats.
    price : float
        What the search cost: log of (alternatives looked at / false-alarm probability), in nats.
        A candidate passes when its gain exceeds it.
    signal : ndarray, shape (n,), or None
        Deterministic part, to be subtracted from the data.
    parts : tuple of Part
        Stationary part: processes and filters, to be added to the model.
    excluded : tuple of (low, high)
        Frequencies in Hz that are left out of the fit.
    shape : tuple of float
        Numbers from which `EffectKind.refine` starts.
    rivals : mapping
        Log-likelihood gains of other kinds for the same symptom, in nats.
    log_alternatives : float or None
        Log of the number of alternatives looked at, where `price` does not tell it: a range without
        a name has no price of its own.
    """

    kind: str
    parameters: Mapping[str, Parameter]
    gain: float
    price: float
    signal: Array | None = field(default=None, repr=False)
    parts: tuple[Part, ...] = ()
    excluded: tuple[tuple[float, float], ...] = ()
    shape: tuple[float, ...] = ()
    words: str = ""
    evidence: Mapping[str, Any] = field(default_factory=dict)
    rivals: Mapping[str, float] = field(default_factory=dict)
    held_out: HeldOut | None = None
    axes: tuple[str, ...] = ()
    log_alternatives: float | None = None

    def number(self, name: str) -> float:
        """Return the value of a parameter that is a number."""
        value = self.parameters[name].value
        if isinstance(value, str):
            raise TypeError(f"{name} of {self.kind} is a name")
        return value

    @property
    def excess(self) -> float:
        """Gain above the price: what candidates are ranked by."""
        return self.gain - self.price

    def log_looked_at(self, alpha: float) -> float:
        """Return the log of the number of alternatives, at the false-alarm rate of the price."""
        if self.log_alternatives is not None:
            return self.log_alternatives
        return self.price + float(np.log(alpha))

    @property
    def is_range(self) -> bool:
        """Whether it is a range of frequencies without a name; a drift is one."""
        return self.kind == "unexplained" and len(self.shape) == 2

    @property
    def is_drift(self) -> bool:
        """Whether it is a slow drift without a name."""
        return self.is_range and self.shape[0] == 0

    @property
    def equivalent(self) -> tuple[str, ...]:
        """Kinds that come within 3 nats: this record cannot rule them out."""
        return tuple(k for k, g in self.rivals.items() if k != self.kind and g > self.gain - 3.0)
