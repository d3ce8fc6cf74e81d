"""From variances to deviations that say how far they can be trusted."""

from __future__ import annotations

from typing import Literal

from numpy.typing import ArrayLike

from allanscope.allan.deviation import Deviation
from allanscope.allan.estimators.base import Sums

__all__ = ["assemble", "wait_seconds"]


def assemble(
    kind: str,
    sums: Sums,
    rate: float,
    level: float = 0.95,
    alpha: ArrayLike | None = None,
    bias_corrected: bool = True,
    hadamard_factor: Literal["sp1065", "dt0064"] = "sp1065",
) -> Deviation:
    """Turn variances into a `Deviation` with chi-square limits.

    Parameters
    ----------
    kind : str
        Estimator name in `REGISTRY`.
    sums : Sums
        Variances with tau0 = 1 in (unit of the data)^2 (tdev, ttotdev: (unit x samples)^2).
    rate : float
        Sample rate in Hz.
    level : float
        Two-sided confidence of the limits.
    alpha : array_like of int, broadcastable to ``sums.variance``, optional
        Power law at each tau, from `allanscope.allan.noise_type.identify`. Without it the limits
        are those of white FM and the noise is ``""``.
    bias_corrected : bool
        Divide MTOT, TTOT and HTOT by their published bias.
    hadamard_factor : {'sp1065', 'dt0064'}
        1/6 or 1/2 in front of the squared third difference.

    Returns
    -------
    Deviation
        On the taus of `sums`; NaN (refused) where there are fewer terms than ``min_terms``.
    """
    raise NotImplementedError


def wait_seconds(kind: str, m: int, n: int, rate: float) -> float:
    """Return how many seconds more a run of `n` samples needs until `m` has a value; 0 if none."""
    raise NotImplementedError
