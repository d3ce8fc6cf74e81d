"""What a reader of curves may choose: estimators, averaging times, factors, noise type, bias."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from allanscope.allan.deviation import Deviation
from allanscope.allan.noise_type import LETTERS, NAMES, alpha_named

if TYPE_CHECKING:
    from allanscope.allan.bank import AllanBank
    from allanscope.allan.estimators import Estimator
    from allanscope.allan.oneshot import Taus

__all__ = ["KINDS", "TAU_SETS", "CurveChoices"]

KINDS = (
    *("stdev", "ostdev", "adev", "oadev", "mdev", "tdev", "hdev", "ohdev"),
    *("totdev", "mtotdev", "ttotdev", "htotdev", "theo1", "theobr", "theoh", "pdev"),
)
"""Every estimator, in the order of tables."""

TAU_SETS = ("octave", "decade", "many", "all")
"""Averaging times by name: powers of two, 1-2-4 in each decade, 24 in each octave, every one."""

_SLOW = ("mtotdev", "ttotdev", "htotdev", "theo1", "theobr", "theoh")
"""Estimators whose effort at one tau is tau times the record: a bank evaluates them from few rows,
an array from all of its samples."""

_ALWAYS = ("oadev",)
"""The readings and the charts need it."""

_MOST_FOR_ALL = 1 << 18
"""Samples up to which every averaging time is evaluated."""
_MOST_SQUARES = 1e11
"""Squares up to which a curve is evaluated from all samples: about 3 min an axis (THEO1 40 s)."""


@dataclass(frozen=True, slots=True)
class CurveChoices:
    """How the curves of a result are made; the closed loop does not depend on it.

    Attributes
    ----------
    kinds : tuple of str
        Estimators; all of them if empty. OADEV is always among them.
    taus : str or tuple of float
        ``""`` for the averaging times of a bank, ``per_octave`` in each octave; octave, decade,
        many or all; or times in s, of which the nearest whole number of samples is taken. All but
        the first two keep every sample in memory and take every term, and leave the modified
        totals and the Theo family to whoever names them.
    per_octave : int
        Averaging times in each octave of a bank.
    hadamard : {'sp1065', 'dt0064'}
        1/6 or 1/2 in front of Hadamard's squared differences.
    noise : str or None
        Noise type for limits and bias instead of the one that is found.
    bias_corrected : bool or 'all'
        As in `deviation`.
    variance : bool
        Show variances beside deviations: AVAR for ADEV.
    simple_limits : bool
        Show DT0064's deviation -+ deviation / sqrt(terms) beside our limits.
    window_s : float
        Length in s of the windows of the Allan deviation over time; 0 has them grow with the run.
    power_laws : str
        Letters of ``QPNBKFD``: power laws whose coefficients are fitted once more, those together;
        ``auto`` for N, B, K and what was identified; none by default.

    Raises
    ------
    ValueError
        For a name that does not exist, a time that is not positive, or no time in each octave.

    Examples
    --------
    >>> CurveChoices(kinds=("hdev",), taus="decade").kinds_of_arrays
    ('hdev', 'oadev')
    >>> CurveChoices(taus="octave").needs_samples
    False
    """

    kinds: tuple[str, ...] = ()
    taus: str | tuple[float, ...] = ""
    per_octave: int = 4
    hadamard: Literal["sp1065", "dt0064"] = "sp1065"
    noise: str | None = None
    bias_corrected: bool | Literal["all"] = True
    variance: bool = False
    simple_limits: bool = False
    window_s: float = 0.0
    power_laws: str = ""

    def __post_init__(self) -> None:
        for kind in self.kinds:
            if kind not in KINDS:
                raise ValueError(f"unknown estimator {kind!r}; choose from {' '.join(KINDS)}")
        if self.noise is not None:
            object.__setattr__(self, "noise", NAMES[alpha_named(self.noise)])
        if self.hadamard not in ("sp1065", "dt0064"):
            raise ValueError(f"unknown Hadamard factor {self.hadamard!r}; choose sp1065 or dt0064")
        if self.bias_corrected not in (True, False, "all"):
            raise ValueError(f"unknown bias correction {self.bias_corrected!r}; choose True or all")
        letters = "" if self.power_laws == "auto" else self.power_laws
        if set(letters) - set(LETTERS.values()):
            raise ValueError(
                f"unknown power laws {letters!r}; choose auto or letters of "
                f"{''.join(LETTERS.values())}"
            )
        if set(letters) & set("FD") and set(letters) & set("QP"):
            raise ValueError("F and D cannot be fitted beside Q and P: omit one of the pairs")
        if not 1 <= self.per_octave <= 64:
            raise ValueError(f"{self.per_octave} averaging times in each octave; take 1 to 64")
        if not 0.0 <= self.window_s < 1e9:
            raise ValueError(f"a window of {self.window_s} s is not possible; 0 grows with the run")
        if isinstance(self.taus, str):
            if self.taus and self.taus not in TAU_SETS:
                names = ", ".join(TAU_SETS)
                raise ValueError(f"unknown taus {self.taus!r}; choose {names} or times in s")
        elif not (self.taus and all(0.0 < tau < 1e12 for tau in self.taus)):
            raise ValueError(f"averaging times must be positive numbers of seconds: {self.taus}")

    @property
    def needs_samples(self) -> bool:
        """Whether the samples themselves are needed: no bank has these averaging times."""
        return self.taus not in ("", "octave")

    @property
    def times_in_each_octave(self) -> int:
        """Averaging times in each octave of the bank."""
        return 1 if self.taus == "octave" else self.per_octave

    @property
    def kinds_of_banks(self) -> tuple[str, ...]:
        """Estimators of a bank."""
        return tuple(dict.fromkeys((*self.kinds, *_ALWAYS))) if self.kinds else KINDS

    @property
    def kinds_of_arrays(self) -> tuple[str, ...]:
        """Estimators of an array of samples."""
        if self.kinds:
            return self.kinds_of_banks
        return tuple(kind for kind in KINDS if kind not in _SLOW)

    def of_bank(self, bank: AllanBank, kind: str, level: float, rate: float) -> Deviation:
        """Return the curve of a bank, at all of its taus."""
        return bank.deviation(
            kind,
            level,
            rate,
            bias_corrected=self.bias_corrected,
            hadamard_factor=self.hadamard,
            noise=self.noise,
        )

    def of_samples(self, data: ArrayLike, kind: str, level: float, rate: float) -> Deviation | None:
        """Return the curve of an array; None where a set of taus has none for this estimator.

        Raises
        ------
        ValueError
            For a time in s that has no value, or more work than anybody waits for.
        """
        from allanscope.allan.estimators import estimator_named
        from allanscope.allan.oneshot import deviation

        values = np.asarray(data, np.float64)
        n = int(np.isfinite(values).sum())
        if self.taus == "all" and n > _MOST_FOR_ALL:
            raise ValueError(
                f"all averaging times of {n} samples take too long; choose many, or times in s"
            )
        taus: Taus
        if isinstance(self.taus, str):
            taus = cast("Taus", self.taus)
            if estimator_named(kind).needed(2) > n:
                return None
        else:
            taus = [_nearest(estimator_named(kind), tau, n, rate) / rate for tau in self.taus]
        _refuse_endless(estimator_named(kind), taus, n, rate)
        return deviation(
            values,
            rate,
            kind,
            taus,
            level=level,
            bias_corrected=self.bias_corrected,
            hadamard_factor=self.hadamard,
            noise=self.noise,
        )


def _refuse_endless(estimator: Estimator, taus: Taus, n: int, rate: float) -> None:
    """Raise ValueError where the windows of a total or of THEO1 have too many squares."""
    from allanscope.allan.oneshot import choose_factors

    if estimator.name not in _SLOW:
        return
    m = choose_factors(estimator, taus, n, rate).astype(np.float64)
    window, squares = (m, m / 2.0) if estimator.even or estimator.name == "theoh" else (3 * m,) * 2
    total = float(np.sum((n - window) * squares))
    if total > _MOST_SQUARES:
        raise ValueError(
            f"{estimator.name} at {m.size} averaging times of {n} samples is a sum of {total:.1g} "
            f"squares, too long to wait for (limit {_MOST_SQUARES:.0e}): choose octave, decade or "
            "fewer times in s"
        )


def _nearest(estimator: Estimator, tau: float, n: int, rate: float) -> int:
    """Return the averaging factor nearest to a time in s."""
    m = round(tau * rate)
    if m < 1:
        raise ValueError(f"tau {tau:g} s is shorter than half a sample of {1 / rate:g} s")
    if float(estimator.tau(m, n)) == m:
        return m
    return max(2 * round(tau * rate / (2 * estimator.tau_factor)), 2)
