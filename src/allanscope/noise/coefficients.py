"""The results of a fit: coefficients with intervals, best averaging, the datasheet's verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

__all__ = ["BestAveraging", "Coefficient", "DatasheetVerdict"]


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
    """

    value: float
    lower: float
    upper: float
    unit: str
    detected: bool
    wait_s: float | None = None


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
