"""What an effect is to the loop: declared facts, and how it proposes itself.

To add a kind, add a file to this folder with one subclass of `EffectKind`; it registers itself.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Parameter
from allanscope.explain.view import View
from allanscope.noise.grid import Grid

__all__ = [
    "ALPHA",
    "KINDS",
    "EffectKind",
    "errors_of",
    "estimate",
    "is_near",
    "is_of_one_scale",
    "log_interval",
    "rescaled",
]

Array = NDArray[np.float64]

ALPHA = 1e-3
"""Probability of a false alarm that each kind may spend on one axis."""

_ALIKE = 1.5
"""Ratio up to which two time constants are the same."""
_SINGULAR = 1e-6
"""Least eigenvalue of a correlation matrix that is not rounding."""

KINDS: dict[str, EffectKind] = {}
"""Every kind by name, in the order in which the files of the folder are read."""


class EffectKind(ABC):
    """One kind of effect.

    Attributes
    ----------
    kind : str
        Its word in the vocabulary.
    meaning : str
        One line for people.
    needs : frozenset of str
        What it must be given: ``samples`` (rows that are single samples), ``temperature``,
        ``axes`` (more than one), ``clock``.
    stage : int
        Kinds of a lower stage are settled first: faults of the data before its physics, and what
        is judged on whitened data after everything that colours it.
    confused_with : mapping
        Other kind to what tells the two apart.
    excluded_by : frozenset of str
        Kinds beside which it is not looked for.
    located_by : str
        Parameter that tells two effects of this kind apart; empty where there can be one.
    is_shared : bool
        Whether the same on several axes is one physical effect.
    is_process : bool
        Whether it is a part of the spectrum: it must recur in both halves of the record.
    is_slow : bool
        Whether it is one of those that pass together though none passes alone (`moves.add_bundle`).
    is_drift, is_piecewise : bool
        Whether it may be a piece of a drift without a name, or of a relaxation without one.
    is_thermal : bool
        Whether it shares the level with the temperature (`moves.add_pair`).
    is_coefficient : bool
        Whether it is one of the textbook's coefficients, which take part in the competition and are
        no effects.
    must_replicate : bool
        Whether the quarters of a record must agree on it.
    """

    kind: ClassVar[str]
    meaning: ClassVar[str]
    needs: ClassVar[frozenset[str]] = frozenset()
    stage: ClassVar[int] = 2
    confused_with: ClassVar[Mapping[str, str]] = {}
    excluded_by: ClassVar[frozenset[str]] = frozenset()
    located_by: ClassVar[str] = ""
    is_shared: ClassVar[bool] = False
    is_process: ClassVar[bool] = False
    is_slow: ClassVar[bool] = False
    is_drift: ClassVar[bool] = False
    is_piecewise: ClassVar[bool] = False
    is_thermal: ClassVar[bool] = False
    is_coefficient: ClassVar[bool] = False
    must_replicate: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        KINDS[cls.kind] = cls()

    @abstractmethod
    def propose(self, view: View) -> Iterable[Candidate]:
        """Return candidates that would explain part of the residual, the noise refitted."""

    def refine(self, view: View, candidate: Candidate) -> Candidate:
        """Estimate an accepted effect again, given everything else that was accepted.

        `view` is without this effect. The default keeps it as it is.
        """
        del view
        return candidate

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Return an accepted effect on a record that has grown since, not searched for again.

        `view` is the record without it; the signal of the candidate has been brought to the rows
        of the view, and its last value stays for what is new. The default leaves it at that.
        """
        del view
        return candidate

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut | None:
        """Judge the candidate on data that was not used to fit it; None where nothing can be."""
        del view, candidate
        return None

    def columns(self, view: View, candidate: Candidate) -> Array | None:
        """Return the first ordinates of what a slow signal is a sum of, shape (p, grid.low).

        One column a number: the signal is linear in them around the candidate. None for what is
        not deterministic, or not slow: that is estimated on its own.
        """
        del view, candidate
        return None

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return the candidate with the amplitudes that a joint regression gave its columns."""
        del view, amplitude, covariance
        return candidate

    def is_same(self, first: Candidate, second: Candidate, grid: Grid) -> bool:
        """Tell whether two candidates of this kind are one hypothesis."""
        del first, second, grid
        return True

    def available(self, view: View) -> bool:
        """Tell whether the record has what this kind needs."""
        has = {
            "samples": view.series.stride == 1,
            "temperature": view.series.thermal is not None,
            "axes": len(view.series.axes) > 1,
            "clock": view.clock is not None,
        }
        return all(has[need] for need in self.needs)


def estimate(value: float, error: float, unit: str = "") -> Parameter:
    """Return a parameter with the 95 % interval of a Gaussian estimate."""
    return Parameter(float(value), float(value - 1.96 * error), float(value + 1.96 * error), unit)


def is_near(first: Candidate, second: Candidate, distance: float) -> bool:
    """Tell whether two candidates lie at one place."""
    return abs(first.shape[0] - second.shape[0]) < distance


def is_of_one_scale(first: Candidate, second: Candidate) -> bool:
    """Tell whether the time constants of two candidates are alike."""
    ratio = first.shape[-1] / second.shape[-1]
    return 1 / _ALIKE < ratio < _ALIKE


def errors_of(information: Array) -> Array:
    """Return the standard errors that an information matrix leaves, NaN if it is not one.

    Where a log-likelihood curves upwards in some direction it has no maximum, and nothing has been
    measured: an error of 0 would claim the opposite.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    if not scale.all() or np.linalg.eigvalsh(information / np.outer(scale, scale))[0] <= _SINGULAR:
        return np.full(len(scale), np.nan)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information))))


def rescaled(candidate: Candidate, name: str, value: float, error: float) -> Candidate:
    """Return a candidate whose signal is proportional to a parameter, with another value of it."""
    assert candidate.signal is not None
    old = candidate.number(name)
    parameter = estimate(value, error, candidate.parameters[name].unit)
    return replace(
        candidate,
        parameters={**candidate.parameters, name: parameter},
        signal=candidate.signal * (value / old) if old else candidate.signal,
    )


def log_interval(value: float, error: float, unit: str = "") -> Parameter:
    """Return a positive parameter with the 95 % interval of an estimate of its logarithm."""
    factor = float(np.exp(1.96 * min(error, 5.0)))
    return Parameter(float(value), float(value / factor), float(value * factor), unit)
