"""Between frequency and averaging time: what each variance passes of a density, and back.

A variance is the integral of the one-sided density of the rate times a transfer function,

    variance(tau) = int_0^(rate/2) S(f) |H(f)|^2 df,

exact in discrete time. With ``s = sin(pi f tau)`` and ``d = m sin(pi f / rate)``, tau = m / rate:

    classical variance   s^2 / d^2               a low-pass: sinc^2
    AVAR, OAVAR          2 s^4 / d^2             a band-pass about 0.37 / tau
    HVAR, OHVAR          8/3 s^6 / d^2
    MVAR                 2 s^6 / d^4
    TVAR                 tau^2 / 3 times MVAR

That of PVAR follows from the slope of s / d, that of THEO1 is a sum over its weights. A density
that was measured at some frequencies (or the phase noise of a carrier) becomes a deviation by
`deviation_of_density`. No variance has an exact inverse: each passes a band of an octave or more.
A deviation becomes a density as the sum of power laws that gives it, by `density_of_deviation`.
The classical variance has neither: of flicker noise and steeper it grows with the run.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.estimators import estimator_named
from allanscope.allan.noise_type import LETTERS
from allanscope.optimise import least_nonnegative

__all__ = [
    "density_of_deviation",
    "deviation_of_density",
    "phase_to_rate_density",
    "rate_to_phase_density",
    "transfer",
]

Floats = NDArray[np.float64]

_SAME_AS = {
    **{"stdev": "ostdev", "adev": "oadev", "hdev": "ohdev", "totdev": "oadev"},
    **{"mtotdev": "mdev", "ttotdev": "tdev", "htotdev": "ohdev", "theobr": "theo1"},
}
"""Estimators whose expectation in a long run is that of another one, their bias removed."""

_UNBIASED = {"theobr": "oadev", "theoh": "oadev"}
"""Hybrids that pass what THEO1 does, scaled to the AVAR of the noise that a record has."""

_LAWS = {"oadev": "QNBK", "theo1": "QNBK", "ohdev": "QNBKFD"}
"""Power laws that a deviation tells apart, by letter; others: QPNBK. AVAR and HVAR fall as 1/tau^2
for white and for flicker phase noise."""

_STEEPEST = {"ohdev": -5.0}
"""Slope of a density towards low frequencies at which a variance is infinite; of others -3."""

_IN_FIRST, _IN_LOBE = 4000, 24
"""Steps in the first lobe of a transfer function, and in each of the others."""

_FOLLOWED, _BLOCKS = 64, 96
"""Lobes that are followed one by one, and blocks of the others."""

_CHUNK = 1 << 22
"""Numbers of a sum over weights that are held at once."""


def transfer(kind: str, f: ArrayLike, m: int, rate: float) -> Floats:
    """Return ``|H(f)|^2`` of an estimator.

    Parameters
    ----------
    kind : str
        Estimator. The totals have the expectation of what they estimate, without their bias; the
        classical variance is that of a run much longer than 1/f.
    f : array_like
        Frequencies in Hz, up to half the rate.
    m : int
        Averaging factor; the even window for the Theo family.
    rate : float
        Samples per second.

    Raises
    ------
    ValueError
        For an unknown estimator, or theoh, which is two.

    Examples
    --------
    >>> f = (np.arange(5000) + 0.5) * 50.0 / 5000  # white noise of density 2 N^2, N = 1, 100 Hz
    >>> round(float(np.mean(2.0 * transfer("oadev", f, 25, 100.0)) * 50.0), 6)  # N^2 / tau
    4.0
    """
    estimator_named(kind)
    name = _SAME_AS.get(kind, kind)
    turns = np.pi * np.asarray(f, np.float64) / rate
    # Frequency zero is a limit, which a frequency next to it has.
    turns = np.where(turns == 0.0, 1e-9 / m, turns)
    s, d = np.sin(m * turns), m * np.sin(turns)
    closed: dict[str, Callable[[], Floats]] = {
        "ostdev": lambda: s**2 / d**2,
        "oadev": lambda: 2.0 * s**4 / d**2,
        "ohdev": lambda: 8.0 / 3.0 * s**6 / d**2,
        "mdev": lambda: 2.0 * s**6 / d**4,
        "tdev": lambda: (m / rate) ** 2 / 3.0 * 2.0 * s**6 / d**4,
        "pdev": lambda: _parabolic(turns, m),
        "theo1": lambda: _theo1(turns, m),
    }
    if name not in closed:
        raise ValueError(f"{kind} is a hybrid of two; ask for oadev and theo1")
    return np.asarray(closed[name]())


def _theo1(turns: Floats, m: int) -> Floats:
    """Return |H|^2 of THEO1: x[i] - x[i+v] + x[i+m] - x[i+m-v] is 2 cos(m) - 2 cos(m - 2v)."""
    flat, v = turns.ravel(), np.arange(1, m // 2 + 1)
    passed = np.empty(flat.size)
    step = max(1, _CHUNK // v.size)
    for first in range(0, flat.size, step):
        part = flat[first : first + step, np.newaxis]
        waves = np.cos(m * part) - np.cos((m - 2 * v) * part)
        passed[first : first + step] = 4.0 * waves**2 @ (1.0 / v)
    return np.asarray(passed.reshape(turns.shape) / (3.0 * (m * np.sin(turns)) ** 2))


def _parabolic(turns: Floats, m: int) -> Floats:
    """Return |H|^2 of PVAR: the difference of two neighbouring slopes of the phase.

    The sum over ((m - 1) / 2 - k) exp(2 i k x) is half the derivative of sin(m x) / sin(x).
    """
    if m == 1:
        return np.asarray(2.0 * np.sin(turns) ** 2)
    sine, angle = np.sin(turns), m * turns
    slope = (m * np.cos(angle) * sine - np.sin(angle) * np.cos(turns)) / sine**2
    slope = np.where(angle < 1e-3, -m * (m**2 - 1.0) / 3.0 * turns, slope)  # digits cancel
    return np.asarray(18.0 * (slope * np.sin(angle)) ** 2 / (float(m) ** 6 * sine**2))


def deviation_of_density(
    f: ArrayLike, density: ArrayLike, m: ArrayLike, rate: float, kind: str = "oadev"
) -> Floats:
    """Return a deviation at averaging factors from a one-sided density of the rate.

    Parameters
    ----------
    f, density : array_like, shape (j,)
        Frequencies in Hz, ascending and positive, and unit^2/Hz there; between them it goes
        straight on double-logarithmic paper, and so it does beyond.
    m : array_like of int, shape (k,)
        Averaging factors; even windows for THEO1.
    rate : float
        Samples per second: the density ends at half of it.
    kind : str
        As in `transfer`. Totals, TheoBR and TheoH have the expectation of what they estimate.

    Raises
    ------
    ValueError
        For the classical variance, which depends on the length of the run, and for a density that
        goes on to frequency zero so steeply that the variance is infinite.

    Examples
    --------
    >>> white = deviation_of_density([0.01, 50.0], [2.0, 2.0], [1, 100], rate=100.0)
    >>> white.round(3).tolist()
    [10.0, 1.0]
    """
    name = _estimated(kind)
    known, levels = np.asarray(f, np.float64), np.asarray(density, np.float64)
    if known.ndim != 1 or known.size < 2 or known.shape != levels.shape:
        raise ValueError("need two or more frequencies and as many densities")
    if not (np.all(np.diff(known) > 0) and known[0] > 0 and np.all(levels > 0)):
        raise ValueError("frequencies must ascend from above 0, and densities be positive")
    slope = math.log(levels[1] / levels[0]) / math.log(known[1] / known[0])
    steepest = _STEEPEST.get(name, -3.0)
    if slope <= steepest + 1e-6:
        other = "" if name == "ohdev" else "; take hdev"
        raise ValueError(
            f"{kind} is infinite for a density that goes on as f^{slope:.2g} below "
            f"{known[0]:g} Hz{other}"
        )
    return np.array(
        [
            math.sqrt(_passed(lambda x: _straight(x, known, levels), factor, rate, name))
            for factor in np.atleast_1d(np.asarray(m)).tolist()
        ]
    )


def _estimated(kind: str) -> str:
    """Return the estimator without bias whose expectation a kind has; ValueError if none does."""
    estimator_named(kind)
    name = _UNBIASED.get(kind, _SAME_AS.get(kind, kind))
    if name == "ostdev":
        raise ValueError(
            f"{kind} and a density do not convert: the classical variance of flicker noise and "
            "random walk grows with the run; take adev"
        )
    return name


def _passed(density: Callable[[Floats], Floats], m: int, rate: float, kind: str) -> Any:
    """Integrate densities, shape (..., frequencies), over what a variance passes of them."""
    f, width = _nodes(m, rate)
    return density(f) @ (transfer(kind, f, m, rate) * width)


def _nodes(m: int, rate: float) -> tuple[Floats, Floats]:
    """Return frequencies up to half the rate, and the width that each stands for.

    Steps in log within the first lobe of the transfer function, then 24 in every lobe. Far above
    tau, where lobes are many, blocks in log are each represented by one lobe.
    """
    lobe, end = rate / m, rate / 2.0
    low = np.geomspace(1e-5 * lobe, min(lobe, end), _IN_FIRST)
    many = max(min(_FOLLOWED * lobe, end), low[-1])
    even = np.linspace(low[-1], many, max(round(_IN_LOBE * (many - low[-1]) / lobe), 1) + 1)
    edges = np.concatenate([low, even[1:]])
    f, width = np.sqrt(edges[1:] * edges[:-1]), np.diff(edges)
    if many >= end:
        return f, width
    blocks = np.geomspace(many, end, _BLOCKS + 1)
    within = lobe * ((np.arange(_IN_LOBE) + 0.5) / _IN_LOBE - 0.5)
    beyond = np.add.outer(np.sqrt(blocks[1:] * blocks[:-1]), within)
    each = np.repeat(np.diff(blocks) / _IN_LOBE, _IN_LOBE)
    return np.concatenate([f, beyond.ravel()]), np.concatenate([width, each])


def _straight(f: Floats, known: Floats, levels: Floats) -> Floats:
    """Interpolate, and go on, straight in the logarithms."""
    x, y = np.log(known), np.log(levels)
    at = np.clip(np.searchsorted(x, np.log(f)) - 1, 0, x.size - 2)
    slope = (y[at + 1] - y[at]) / (x[at + 1] - x[at])
    return np.asarray(np.exp(y[at] + slope * (np.log(f) - x[at])))


def density_of_deviation(
    tau: ArrayLike,
    deviation: ArrayLike,
    f: ArrayLike,
    kind: str = "oadev",
    rate: float | None = None,
) -> Floats:
    """Return the one-sided density of the sum of power laws nearest to a deviation.

    Parameters
    ----------
    tau, deviation : array_like, shape (k,)
        Averaging times in s and the deviation there, in the unit of the rate (`tdev`: times s).
    f : array_like, shape (j,)
        Frequencies in Hz.
    kind : str
        Estimator, as in `deviation_of_density`.
    rate : float, optional
        Samples per second; by default the shortest tau is assumed to be that of one sample (of two
        for THEO1).

    Raises
    ------
    ValueError
        For the classical variance, and numbers that make no sense.

    Notes
    -----
    Power laws of sampled noise, ``|2 sin(pi f / rate)|^alpha``, with levels none of which is
    negative, by least squares of measured / fitted. Which, depends on what the deviation tells
    apart: white PM, white FM, flicker FM and random walk for AVAR and THEO1; flicker PM too for
    MVAR, TVAR and PVAR; flicker walk and random run, but not flicker PM, for HVAR. A drift has no
    density.

    Examples
    --------
    >>> tau = np.array([0.1, 1.0, 10.0])
    >>> density_of_deviation(tau, 3.0 / np.sqrt(tau), [1.0, 5.0]).round(2).tolist()
    [18.0, 18.0]
    """
    t, variance = np.asarray(tau, np.float64), np.asarray(deviation, np.float64) ** 2
    if t.shape != variance.shape or t.ndim != 1 or not (np.all(t > 0) and np.all(variance > 0)):
        raise ValueError("need as many positive deviations as positive averaging times")
    name = _estimated(kind)
    hz = rate or (1.5 if name == "theo1" else 1.0) / float(t.min())
    letters = _LAWS.get(name, "QPNBK")
    alphas = np.array([alpha for alpha, letter in LETTERS.items() if letter in letters])

    def laws(x: Floats) -> Floats:
        """Return the density of every power law, shape (laws, frequencies)."""
        rising = 2.0 * np.sin(np.pi * np.minimum(x, hz / 2.0) / hz)
        return np.asarray(rising ** alphas[:, np.newaxis])

    lines = np.array([_passed(laws, m, hz, name) for m in factors_at(t, hz, kind)])
    scale = lines.max(axis=0)
    squares = least_nonnegative(lines / scale / variance[:, np.newaxis], np.ones_like(t))
    return np.asarray((squares / scale) @ laws(np.asarray(f, np.float64)))


def factors_at(tau: ArrayLike, rate: float, kind: str = "oadev") -> list[int]:
    """Return the averaging factors nearest to averaging times; even windows for THEO1.

    Examples
    --------
    >>> factors_at([0.3, 1.0], 10.0), factors_at([0.3, 1.2], 10.0, "theo1")
    ([3, 10], [4, 16])
    """
    exact = np.asarray(tau, np.float64) * rate
    if _estimated(kind) == "theo1":
        return [max(2 * round(m / 1.5), 2) for m in exact.tolist()]
    return [max(round(m), 1) for m in exact.tolist()]


def phase_to_rate_density(f: ArrayLike, phase: ArrayLike, carrier: float = 0.0) -> Floats:
    """Return S_y from S_phi in rad^2/Hz: (f / carrier)^2 S_phi; without a carrier (2 pi f)^2.

    Without a carrier the phase is an angle and the rate its derivative, in rad/s.

    Examples
    --------
    >>> phase_to_rate_density([10.0], [1e-10], carrier=1e7).tolist()
    [1e-22]
    """
    return np.asarray(_squared_ratio(f, carrier) * np.asarray(phase, np.float64))


def rate_to_phase_density(f: ArrayLike, rate: ArrayLike, carrier: float = 0.0) -> Floats:
    """Return S_phi in rad^2/Hz from S_y, the inverse of `phase_to_rate_density`."""
    return np.asarray(np.asarray(rate, np.float64) / _squared_ratio(f, carrier))


def _squared_ratio(f: ArrayLike, carrier: float) -> Floats:
    if not (math.isfinite(carrier) and carrier >= 0.0):
        raise ValueError(f"the carrier must be a frequency in Hz, got {carrier!r}")
    return (np.asarray(f, np.float64) * (1.0 / carrier if carrier else 2.0 * math.pi)) ** 2
