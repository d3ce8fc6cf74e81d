"""Coefficients of every power law: those of phase noise, and those steeper than a random walk.

The fit of a result has N, B, K and, where the data ask for it, Q. A record that has flicker phase
noise (P), a flicker walk (F) or a random run (D) is fitted here, by the same likelihood::

    alpha    +2   +1    0   -1   -2   -3   -4
    letter    Q    P    N    B    K    F    D

F and D make a record whose spectrum at the lowest frequencies is that of its two ends. Its first
differences have none of that: two powers less steep, they are fitted as what they are, and every
letter moves by two places (N as Q, B as P, K as N, F as B, D as K).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from allanscope.noise.coefficients import Coefficient
from allanscope.noise.components import (
    AngleQuantization,
    Flicker,
    FlickerPhase,
    RandomWalk,
    White,
)
from allanscope.noise.estimates import Estimates
from allanscope.noise.evidence import evidence_of
from allanscope.noise.likelihood import Likelihood
from allanscope.noise.model import NoiseModel
from allanscope.noise.part import Component

__all__ = ["POWER_LAWS", "fit_power_laws"]

POWER_LAWS = {"Q": 2, "P": 1, "N": 0, "B": -1, "K": -2, "F": -3, "D": -4}
"""Letter of each power law to alpha of S(f) ~ f^alpha."""

_BY_ALPHA: Mapping[int, tuple[str, type[Component]]] = {
    2: ("Q", AngleQuantization),
    1: ("P", FlickerPhase),
    0: ("N", White),
    -1: ("B", Flicker),
    -2: ("K", RandomWalk),
}
_UNITS = {
    **{"Q": "{}*s", "P": "{}*s", "N": "{}/sqrt(Hz)", "B": "{}", "K": "{}/sqrt(s)"},
    **{"F": "{}/s", "D": "{}/s/sqrt(s)"},
}


def fit_power_laws(
    values: ArrayLike, rate: float, noises: str = "QPNBK", *, unit: str = "dps"
) -> dict[str, Coefficient]:
    """Return the coefficients of the power laws that are named, with intervals.

    Parameters
    ----------
    values : array_like, shape (n,)
        Contiguous samples in `unit`.
    rate : float
        Samples per second.
    noises : str
        Letters of ``QPNBKFD``; with F or D, no Q and no P: nothing bears both out.
    unit : str
        Of the values.

    Returns
    -------
    dict of str to Coefficient
        `Coefficient.detected` is false for what the record does not show; then `upper` is the
        limit.

    Raises
    ------
    ValueError
        For fewer than 16 values, values that are not finite, other letters, or F or D beside Q, P.

    Examples
    --------
    >>> run = 1e-4 * np.random.default_rng(3).normal(size=20_000).cumsum().cumsum()
    >>> found = fit_power_laws(run, rate=1.0, noises="KD")
    >>> found["D"].lower < 1e-4 < found["D"].upper, found["D"].unit, found["K"].detected
    (True, 'dps/s/sqrt(s)', False)
    """
    if not noises or set(noises) - set(POWER_LAWS):
        raise ValueError(f"noises must be letters of {''.join(POWER_LAWS)}, got {noises!r}")
    steep = bool(set(noises) & set("FD"))
    if steep and set(noises) & set("QP"):
        raise ValueError("F and D cannot be fitted beside Q and P: leave one of the pairs out")
    samples = np.asarray(values, np.float64)
    if samples.ndim != 1 or samples.size < 17 or not np.isfinite(samples).all():
        raise ValueError("need a row of 17 or more finite values")
    dt = 1.0 / rate
    if steep:
        samples = np.diff(samples) * rate
    shift = 2 if steep else 0
    chosen = {letter: _BY_ALPHA[POWER_LAWS[letter] + shift] for letter in noises}
    model = NoiseModel(tuple(make(1.0) for _, make in chosen.values()), dt)  # type: ignore[call-arg]
    fit = Likelihood(evidence_of([samples[np.newaxis]], dt)).amplitudes(model)
    estimates = Estimates(fit, dt, samples.size * dt, unit)
    found = {}
    for letter, (name, _) in chosen.items():
        one = estimates.coefficient(name)
        # White noise has N / sqrt(dt) a sample, and that is the Q of its differences over dt.
        factor = np.sqrt(dt) if steep and letter == "N" else 1.0
        found[letter] = replace(
            one,
            value=one.value * factor,
            lower=one.lower * factor,
            upper=one.upper * factor,
            unit=_UNITS[letter].format(unit),
        )
    return found
