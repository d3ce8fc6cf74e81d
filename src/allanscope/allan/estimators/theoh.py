"""THEOH: the Allan deviation as long as it is good, bias-removed THEO1 beyond."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.estimators.base import REGISTRY, register
from allanscope.allan.estimators.oadev import Oadev
from allanscope.allan.estimators.theobr import Floats, Ints, TheoBR
from allanscope.allan.noise_type import NoiseTypes

__all__ = ["TheoH"]

_SHORT = 0.1
"""Part of the run up to which the Allan variance is used."""


@register
class TheoH(TheoBR):
    """Hybrid of OAVAR and TheoBR: one curve from tau0 to three quarters of the run, trusted to one.

    OAVAR at tau = m up to a tenth of the run, TheoBR at tau = 0.75 m (m even) above (J. Taylor and
    D. Howe 2010: THEOH; NIST SP 1065; DT0064: Theo1H). Degrees of freedom are those of the
    part.

    Examples
    --------
    In a run of 1000 samples m = 100 is the last that stands for itself:

    >>> TheoH().tau([1, 100, 200], 1000).tolist()
    [1.0, 100.0, 150.0]
    >>> TheoH().admits(101, 1000), TheoH().admits(134, 1000)
    (False, True)

    The variance at m = 40 as the run grows: THEOBR until 400 samples make it a tenth of the run.

    >>> x = np.append(0.0, np.random.default_rng(4).standard_normal(2000).cumsum())
    >>> [round(TheoH().exact(x[: n + 1], 40)[0], 3) for n in (88, 89, 200, 399, 400, 800)]
    [nan, 0.01, 0.03, 0.036, 0.023, 0.026]
    """

    name: ClassVar[str] = "theoh"
    variance_name: ClassVar[str] = "THEOH"
    even: ClassVar[bool] = False
    calibrated_as: ClassVar[str] = "theobr"

    def admits(self, m: int, n: int) -> bool:
        """Return whether `m` is an averaging factor of one part or an even window of the other."""
        return 1 <= m <= _SHORT * n or (m % 2 == 0 and 0.75 * m > _SHORT * n)

    def tau(self, m: ArrayLike, n: int) -> NDArray[np.float64]:
        """Return m up to a tenth of the run, 0.75 m above."""
        m = np.asarray(m, np.float64)
        return np.where(m <= _SHORT * n, m, self.tau_factor * m)

    def exact(self, phase: NDArray[np.float64], m: int) -> tuple[float, int]:
        """Return variance and number of terms or windows."""
        return self.curve(phase, [m])[0]

    def curve(self, phase: NDArray[np.float64], factors: Iterable[int]) -> list[tuple[float, int]]:
        """Return `exact` for each m."""
        factors = list(factors)
        short = [m for m in factors if m <= _SHORT * (phase.size - 1)]
        long = factors[len(short) :]
        allan = [REGISTRY[Oadev.name].exact(phase, m) for m in short]
        return allan + (super().curve(phase, long) if long else [])

    def trusts(self, noise: NoiseTypes, tau: ArrayLike, n: int) -> NDArray[np.bool_]:
        """Return whether the limits hold: those of OAVAR do in any noise."""
        return (np.asarray(tau) <= _SHORT * n) | super().trusts(noise, tau, n)

    def edf(
        self, alpha: ArrayLike, m: ArrayLike, n: ArrayLike, stride: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the degrees of freedom of the part that m belongs to."""
        m, n = np.asarray(m), np.asarray(n)
        short = m <= _SHORT * n
        allan = REGISTRY[Oadev.name].edf(
            alpha, np.where(short, m, 1), n, np.where(short, stride, 1)
        )
        return np.where(short, allan, super().edf(alpha, m, n, stride))

    def of_mixture(
        self, noise: NoiseTypes, m: Ints, n: Ints, stride: ArrayLike
    ) -> tuple[Floats, Floats, Floats]:
        """Return degrees of freedom, expectation and bias of the part that m belongs to."""
        short = m <= _SHORT * np.max(n)
        first = REGISTRY[Oadev.name].of_mixture(noise, m, n, np.where(short, stride, 1))
        if short.all():
            return first
        second = super().of_mixture(noise, m, n, stride)
        edf, expectation, left = (np.where(short, a, b) for a, b in zip(first, second, strict=True))
        return edf, expectation, left

    def limit_scale(self, noise: NoiseTypes, m: Ints, n: Ints) -> Floats:
        """Return that of the part that m belongs to."""
        return np.where(m <= _SHORT * np.max(n), 1.0, super().limit_scale(noise, m, n))

    def needed(self, m: int) -> int:
        """Return how many rate samples give a value: at tau = 0.75 m or, if not there, at m."""
        window = super().needed(m)
        return window if m % 2 == 0 and 0.75 * m > _SHORT * window else 10 * m
