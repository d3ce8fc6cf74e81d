"""Coefficients of every power law: those of phase noise, and those steeper than a random walk.

The fit of a result has N, B, K and, where the data ask for it, Q. A record that has flicker phase
noise (P), a flicker walk (F) or a random run (D) is fitted here, by the same likelihood: an array
with `fit_power_laws`, an axis of a run with `power_laws_of`, beside the effects found on it::

    alpha    +2   +1    0   -1   -2   -3   -4
    letter    Q    P    N    B    K    F    D

F and D make a record whose spectrum at the lowest frequencies is that of its two ends. Its first
differences have none of that: two powers less steep, they are fitted as what they are, and every
letter moves by two places (N as Q, B as P, K as N, F as B, D as K).

In differences of white noise (Q, and N of a steep record) the first and the last value have no
counterpart: two numbers that raise all low ordinates together. They are estimated and taken out, as
two draws are no spectrum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from allanscope.allan import LETTERS
from allanscope.history import Record
from allanscope.noise.coefficients import Coefficient
from allanscope.noise.components import (
    AngleQuantization,
    Flicker,
    FlickerPhase,
    FlickerWalk,
    Ramp,
    RandomRun,
    RandomWalk,
    White,
)
from allanscope.noise.estimates import Estimates
from allanscope.noise.evidence import Evidence, Ordinates, evidence_of, stretches_of
from allanscope.noise.filters import Remainder
from allanscope.noise.fit import NoiseFit
from allanscope.noise.likelihood import Fit, Likelihood
from allanscope.noise.model import NoiseModel
from allanscope.noise.part import Array, Component
from allanscope.samples import unit_of

__all__ = ["POWER_LAWS", "fit_power_laws", "model_of", "power_laws_of"]

POWER_LAWS = {letter: alpha for alpha, letter in LETTERS.items()}
"""Letter of each power law to alpha of S(f) ~ f^alpha."""

_USUAL = "NBK"
_FAST, _SLOW = "QP", "FD"
"""Tried beside the usual ones."""
_PRICE = math.log(1e3) + math.log(len(_FAST + _SLOW))
"""Log-likelihood gain that a letter must bring: odds of 1 in 1000, for each that is tried."""
_ROUNDS = 2
"""So often the ends are found again with the model that their removal gave."""
_SHARE = 0.1
"""Of the sample rate: for a steep fit, rows above it say nothing that a filter does not bend."""

_BY_ALPHA: Mapping[int, tuple[str, Callable[[float], Component]]] = {
    2: ("Q", AngleQuantization),
    1: ("P", FlickerPhase),
    0: ("N", White),
    -1: ("B", Flicker),
    -2: ("K", RandomWalk),
    -3: ("F", FlickerWalk),
    -4: ("D", RandomRun),
}
"""Exponent of the density, as f^alpha, to coefficient and component."""
_REPLACED = (*(name for name, _ in _BY_ALPHA.values()), "R", "power_law")
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
        Letters of ``QPNBKFD``; with F or D, no Q and no P: nothing bears both out. ``"auto"``: N,
        B, K and those without which the likelihood is too poor for chance.
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
    letters = _checked(noises)
    samples = np.asarray(values, np.float64)
    if samples.ndim != 1 or samples.size < 17 or not np.isfinite(samples).all():
        raise ValueError("need a row of 17 or more finite values")
    dt, duration = 1.0 / rate, samples.size / rate

    def differences() -> Sequence[Evidence]:
        return evidence_of([np.diff(samples)[np.newaxis] * rate], dt)

    evidence = evidence_of([samples[np.newaxis]], dt)
    return _either(letters, NoiseModel((), dt), evidence, differences, duration, unit)


def power_laws_of(
    record: Record, axis: str, noises: str, fit: NoiseFit, signal: Array | float = 0.0
) -> dict[str, Coefficient]:
    """Return the coefficients of the power laws that are named, of an axis of a run.

    Parameters
    ----------
    record : Record
        Rows of all axes.
    axis : str
        Which one.
    noises : str
        Letters as for `fit_power_laws`.
    fit : NoiseFit
        Of this axis: its evidence is fitted again, beside its effects and behind its filters. With
        F or D the differences of the rows are, up to a tenth of their rate.
    signal : ndarray, shape (n,), or float
        What the effects add to the rows, steps and slow signals among them.

    Raises
    ------
    ValueError
        As `fit_power_laws`, or when no stretch of rows is long enough.
    """
    letters, unit = _checked(noises), unit_of(axis)
    row_s = 1.0 / record.rate_hz
    duration = len(record.values) * row_s

    def differences() -> Sequence[Evidence]:
        values = record.values[:, record.axes.index(axis)] - signal
        stretches = stretches_of(values, [(int(a), int(b) - 1) for a, b in record.segments])
        steps = [np.diff(table, axis=1) / row_s for table in stretches]
        return [part.without(((_SHARE / row_s, np.inf),)) for part in evidence_of(steps, row_s)]

    others = tuple(c for c in fit.model if c.symbol not in _REPLACED)
    filters = tuple(f for f in fit.model.filters if not isinstance(f, Remainder))
    beside = NoiseModel(others, fit.model.dt, filters)
    return _either(letters, beside, fit.evidence, differences, duration, unit)


def model_of(text: str, dt: float) -> NoiseModel:
    """Return the model that ``N=0.003,B=0.001`` describes, of Q, P, N, B, K, F, D and R.

    Of F and D only the Hadamard family has a variance; of others it is infinite.

    Raises
    ------
    ValueError
        For another letter, or what is not a number.

    Examples
    --------
    >>> model_of("N=4e-3,K=1e-4", 0.01).deviation("oadev", [100]).round(6).tolist()
    [0.004]
    """
    known: dict[str, Callable[[float], Component]] = {**dict(_BY_ALPHA.values()), "R": Ramp}
    parts: list[Component] = []
    for part in text.split(","):
        letter, _, value = part.partition("=")
        if letter not in known:
            raise ValueError(f"model {text!r}: write e.g. N=0.003,B=0.001, of {' '.join(known)}")
        try:
            parts.append(known[letter](float(value)))
        except ValueError:
            raise ValueError(f"model {text!r}: {value!r} is not a number above zero") from None
    return NoiseModel(tuple(parts), dt)


def _either(
    letters: str,
    beside: NoiseModel,
    evidence: Sequence[Evidence],
    differences: Callable[[], Sequence[Evidence]],
    duration: float,
    unit: str,
) -> dict[str, Coefficient]:
    """Fit the samples or, with F or D, their differences; ``auto`` finds what they ask for."""
    dt = beside.dt
    within = differences() if letters == "auto" or _is_steep(letters) else ()
    if letters == "auto":
        fast, gain = _asked_for(_FAST, beside, evidence)
        slow, more = _asked_for(_SLOW, NoiseModel((), dt), within, shift=2)
        letters = "".join(x for x in POWER_LAWS if x in _USUAL + (slow if more > gain else fast))
    if _is_steep(letters):
        return _steep(letters, within, dt, duration, unit)
    return _fitted(letters, beside, evidence, duration, unit)


def _asked_for(
    tried: str, beside: NoiseModel, evidence: Sequence[Evidence], shift: int = 0
) -> tuple[str, float]:
    """Return the letters without which N, B and K are too poor, and the gain of the first.

    All are compared on the same evidence: of differences that without the ends of the record, which
    the model with every letter finds.
    """
    if shift:
        evidence = _inner(_parts(_USUAL + tried, shift), beside, evidence)[1]

    def gained(letters: str) -> float:
        parts = _parts(_USUAL + letters, shift)
        if shift:
            parts["N"] = _InnerDifferences(1.0)
        return _maximum(parts, beside, evidence).loglik

    base, found, first = gained(""), "", 0.0
    while left := [letter for letter in tried if letter not in found]:
        best, letter = max((gained(found + letter) - base, letter) for letter in left)
        if best <= _PRICE:
            break
        base, found, first = base + best, found + letter, first or best
    return found, first


def _checked(noises: str) -> str:
    """Return the letters, each once; ValueError for what cannot be fitted."""
    if noises == "auto":
        return noises
    if not noises or set(noises) - set(POWER_LAWS):
        raise ValueError(f"noises must be letters of {''.join(POWER_LAWS)}, got {noises!r}")
    if _is_steep(noises) and set(noises) & set("QP"):
        raise ValueError("F and D cannot be fitted beside Q and P: omit one of the pairs")
    return "".join(dict.fromkeys(noises))


def _is_steep(letters: str) -> bool:
    return bool(set(letters) & set("FD"))


def _steep(
    letters: str, evidence: Sequence[Evidence], dt: float, duration: float, unit: str
) -> dict[str, Coefficient]:
    """Fit differences over dt, in which every power law is two powers less steep."""
    fit = _fit(_parts(letters, shift=2), NoiseModel((), dt), evidence)
    found = _coefficients(letters, fit, duration, unit, shift=2)
    if "N" in found:
        # White noise has N / sqrt(dt) a sample, and that is the Q of its differences over dt.
        found["N"] = found["N"].scaled(np.sqrt(dt))
    return found


def _fitted(
    letters: str, beside: NoiseModel, evidence: Sequence[Evidence], duration: float, unit: str
) -> dict[str, Coefficient]:
    fit = _fit(_parts(letters), beside, evidence)
    return _coefficients(letters, fit, duration, unit)


def _parts(letters: str, shift: int = 0) -> dict[str, Component]:
    return {letter: _BY_ALPHA[POWER_LAWS[letter] + shift][1](1.0) for letter in letters}


def _fit(parts: Mapping[str, Component], beside: NoiseModel, evidence: Sequence[Evidence]) -> Fit:
    """Return the maximum; of differences of white noise without those of the ends."""
    return _inner(parts, beside, evidence)[0]


def _inner(
    parts: Mapping[str, Component], beside: NoiseModel, evidence: Sequence[Evidence]
) -> tuple[Fit, Sequence[Evidence]]:
    """Return the maximum and the evidence without the ends, where there are any."""
    found, without = _maximum(parts, beside, evidence), evidence
    for letter, part in parts.items():
        if isinstance(part, AngleQuantization):
            inner = {**parts, letter: _InnerDifferences(1.0)}
            for _ in range(_ROUNDS):
                without = _without_ends(evidence, found)
                found = _maximum(inner, beside, without)
    return found, without


def _maximum(
    parts: Mapping[str, Component], beside: NoiseModel, evidence: Sequence[Evidence]
) -> Fit:
    model = NoiseModel((*parts.values(), *beside.components), beside.dt, beside.filters)
    return Likelihood(evidence).maximise(model)


@dataclass(frozen=True)
class _InnerDifferences(AngleQuantization):
    """Differences of white noise whose first and last value are not noise."""

    def ordinates(self, k: ArrayLike, n: int, dt: float, stride: int = 1) -> Array:
        """Return 4 Q^2 / (s dt)^2 sin^2(pi k / 2n), without what the ends of a record add."""
        half = np.pi * np.asarray(k, np.float64) / (2 * n)
        return np.asarray(4 * (self.Q * np.sin(half) / (stride * dt)) ** 2)


def _without_ends(evidence: Sequence[Evidence], fit: Fit) -> list[Evidence]:
    """Return evidence without the white noise of the first and the last value of each stretch.

    By parts, ordinate k of the differences of x[0] ... x[n] is that of what lies between plus
    ``c (-x[0] + (-1)^k x[n])`` with ``c = sqrt(2/n) cos(pi k / 2n)``: a sum for even k, a
    difference for odd k, each found by least squares with the weights of a fit.
    """
    inner: list[Evidence] = []
    first = 0
    for part in evidence:
        expected = fit.expected[first : first + len(part.power)]
        first += len(part.power)
        inner.append(_less_ends(part, expected) if isinstance(part, Ordinates) else part)
    return inner


def _less_ends(part: Ordinates, expected: Array) -> Ordinates:
    grid = part.grid
    weight = np.repeat(1.0 / expected, grid.count[: len(expected)].astype(np.int64))
    weight *= grid.kept(part.excluded)[: len(weight)]
    k = np.arange(1, len(weight) + 1)
    ends = np.cos(np.pi * k / (2 * grid.n))
    pattern = np.zeros((len(part.raw), len(weight)))
    for chosen in (k % 2 == 0, k % 2 == 1):
        shape = np.where(chosen, ends, 0.0)
        size = part.raw[:, : len(weight)] @ (weight * shape) / np.sum(weight * shape**2)
        pattern += size[:, np.newaxis] * shape
    return part.less(pattern)


def _coefficients(
    letters: str, fit: Fit, duration: float, unit: str, shift: int = 0
) -> dict[str, Coefficient]:
    estimates = Estimates(fit, fit.model.dt, duration, unit)
    return {
        letter: replace(
            estimates.coefficient(_BY_ALPHA[POWER_LAWS[letter] + shift][0]),
            unit=_UNITS[letter].format(unit),
        )
        for letter in letters
    }
