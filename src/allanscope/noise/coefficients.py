"""The results of a fit: coefficients with intervals, best averaging, the datasheet's verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from allanscope.allan import Deviation
from allanscope.quantities import TWO_SIDED_95

__all__ = [
    "BestAveraging",
    "Coefficient",
    "CoefficientPart",
    "DatasheetVerdict",
    "Uncertainty",
    "find_best_averaging",
]


@dataclass(frozen=True, slots=True)
class CoefficientPart:
    """A part of a coefficient: estimate, 95 % interval, and whether it was detected."""

    value: float
    lower: float
    upper: float
    detected: bool

    @classmethod
    def of(cls, whole: Coefficient) -> CoefficientPart:
        """Return a coefficient as the part of another."""
        return cls(whole.value, whole.lower, whole.upper, whole.detected)


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """The uncertainty of a coefficient as laboratories state it.

    Attributes
    ----------
    standard, expanded : float
        Standard uncertainty, and `coverage_factor` times that, in the unit of the coefficient.
    coverage_factor : float
        2: about 95 % of a normal distribution.
    degrees_of_freedom : float
        Effective ones: those of a mean of squares whose root is as uncertain.
    """

    standard: float
    expanded: float
    coverage_factor: float
    degrees_of_freedom: float


@dataclass(frozen=True, slots=True)
class Coefficient:
    """One noise coefficient of IEEE 952 (Q, N, B, K or R).

    Attributes
    ----------
    value : float
        Estimate, never negative.
    lower, upper : float
        95 % interval; `lower` is 0 where zero cannot be ruled out.
    unit : str
        E.g. ``dps/sqrt(Hz)``.
    detected : bool
        False when the data give only the upper limit.
    wait_s : float or None
        How much longer to run until it can be expected to be known to about 20 %; None when it is
        known already or when nothing can be said.
    white_alone : CoefficientPart or None
        Of N: the white noise of the axis alone, where N has more in it, a process of short
        correlation time or another axis; else None.
    decoupled : CoefficientPart or None
        Of N: what it is without other axes that leak in, where one does; else None.
    """

    value: float
    lower: float
    upper: float
    unit: str
    detected: bool
    wait_s: float | None = None
    white_alone: CoefficientPart | None = None
    decoupled: CoefficientPart | None = None

    @property
    def uncertainty(self) -> Uncertainty | None:
        """What half the 95 % interval amounts to; None where there is only an upper limit.

        The root of a mean of nu squares has a relative standard deviation of 1 / sqrt(2 nu).

        Examples
        --------
        >>> known = Coefficient(4.0, 3.902, 4.098, "dps/sqrt(Hz)", True).uncertainty
        >>> round(known.standard, 4), round(known.expanded, 4), round(known.degrees_of_freedom)
        (0.05, 0.1, 3200)
        """
        standard = (self.upper - self.lower) / (2.0 * TWO_SIDED_95)
        if not (self.detected and self.value > 0.0 and 0.0 < standard < math.inf):
            return None
        return Uncertainty(standard, 2.0 * standard, 2.0, 0.5 * (self.value / standard) ** 2)

    def scaled(self, factor: float) -> Coefficient:
        """Return it with value and limits times a factor."""
        limits = {name: factor * getattr(self, name) for name in ("value", "lower", "upper")}
        return replace(self, **limits)


@dataclass(frozen=True, slots=True)
class BestAveraging:
    """How many samples to average for the smallest variance, DT0064's own question.

    Attributes
    ----------
    tau, samples : float, int
        Averaging time in s, and the samples in it, at the smallest deviation.
    deviation, lower, upper : float
        That deviation and its limits.
    tau_lower, tau_upper : float
        Averaging times in s between which the true minimum lies; `tau_upper` is infinite where the
        run is too short to say.
    at_end : bool
        True when the curve has not risen out of the interval by the end of what can be trusted:
        the true minimum may lie further out.
    """

    tau: float
    samples: int
    deviation: float
    lower: float
    upper: float
    tau_lower: float
    tau_upper: float
    at_end: bool = False


@dataclass(frozen=True, slots=True)
class DatasheetVerdict:
    """One value of the datasheet against what was measured.

    Attributes
    ----------
    limit, measured : float or None
        One-sided density, or rms, in `unit`; None when not published, or not measured yet.
    unit : str
        ``dps/sqrt(Hz)``, ``g/sqrt(Hz)``, ``dps`` or ``g``, never a multiple.
    verdict : str
        ``better``, ``typical``, ``worse``, ``not published``, ``not known yet`` or
        ``hidden by the step``.
    explanation : str
        One sentence with the convention spelled out.
    """

    limit: float | None
    measured: float | None
    unit: str
    verdict: str
    explanation: str = ""
    details: dict[str, float] = field(default_factory=dict)

    @property
    def white_limit(self) -> float | None:
        """N that the published density amounts to: over sqrt(2), since N is two-sided."""
        return None if self.limit is None else self.limit / math.sqrt(2.0)


def find_best_averaging(curve: Deviation) -> BestAveraging | None:
    """Return the averaging time of the smallest deviation among those that can be trusted.

    A minimum counts as one only if the curve has risen out of its interval by the end of what can
    be trusted. Otherwise it may lie further out: `at_end`. Where the true minimum can be is said by
    the averaging times whose deviations lie within the interval of the smallest; that holds it in
    98 of 100 runs or more, by simulation.

    Parameters
    ----------
    curve : Deviation
        One axis, e.g. ``oadev``.

    Returns
    -------
    BestAveraging or None
        None where no point can be trusted.

    Examples
    --------
    >>> m = np.array([1, 2, 4, 8])
    >>> dev = np.array([2.0, 1.0, 1.5, 2.5])
    >>> curve = Deviation("oadev", m / 100, m, dev, 0.9 * dev, 1.1 * dev, np.full(4, 99.0),
    ...                   np.full(4, 99), np.full(4, "WFM"), 0.95, m > 0)
    >>> best = find_best_averaging(curve)
    >>> best.tau, best.samples, best.deviation, best.at_end
    (0.02, 2, 1.0, False)
    >>> best.tau_lower, best.tau_upper
    (0.02, 0.02)
    """
    if curve.deviation.ndim != 1:
        raise ValueError("look at one axis at a time: take deviation.axis(column)")
    usable = np.flatnonzero(curve.trusted & np.isfinite(curve.deviation))
    if len(usable) == 0:
        return None
    best = usable[np.argmin(curve.deviation[usable])]
    upper = curve.upper[best]
    near = usable[curve.deviation[usable] <= upper]
    at_end = bool(np.all(curve.deviation[usable[usable > best]] <= upper))
    still_near = at_end or near[-1] == usable[-1]
    return BestAveraging(
        tau=float(curve.tau[best]),
        samples=int(curve.m[best]),
        deviation=float(curve.deviation[best]),
        lower=float(curve.lower[best]),
        upper=float(upper),
        tau_lower=float(curve.tau[near[0]]),
        tau_upper=np.inf if still_near else float(curve.tau[near[-1]]),
        at_end=at_end,
    )
