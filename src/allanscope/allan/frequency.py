"""Between frequency and averaging time: what each variance passes of a density, and back.

A variance is the integral of the one-sided density of the rate times a transfer function,

    variance(tau) = int_0^(rate/2) S(f) |H(f)|^2 df,

exact in discrete time. With ``s = sin(pi f tau)`` and ``d = m sin(pi f / rate)``, tau = m / rate:

    classical variance   s^2 / d^2               a low-pass: sinc^2
    AVAR, OAVAR          2 s^4 / d^2             a band-pass about 0.37 / tau
    HVAR, OHVAR          8/3 s^6 / d^2
    MVAR                 2 s^6 / d^4
    TVAR                 tau^2 / 3 times MVAR

Those of PVAR and THEO1 are sums over their weights. A density that was measured at some
frequencies (or the phase noise of a carrier) becomes a deviation by `deviation_of_density`; a
deviation becomes a density as a sum of power laws, by `density_of_deviation`, because a band-pass
as wide as that of AVAR does not tell more.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.estimators import estimator_named

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
    v = np.arange(1, m // 2 + 1)
    waves = np.cos(m * turns)[..., np.newaxis] - np.cos(np.multiply.outer(turns, m - 2 * v))
    passed = np.sum(4.0 * waves**2 / v, axis=-1)
    return np.asarray(passed / (0.75 * 4.0 * (m * np.sin(turns)) ** 2))


def _parabolic(turns: Floats, m: int) -> Floats:
    """Return |H|^2 of PVAR: the difference of two neighbouring slopes of the phase."""
    if m == 1:
        return np.asarray(2.0 * np.sin(turns) ** 2)
    k = np.arange(m)
    line = (m - 1) / 2.0 - k
    waves = np.exp(2j * np.multiply.outer(turns, k)) @ line
    second = waves * (1.0 - np.exp(2j * turns * m))
    return np.asarray(72.0 * np.abs(second) ** 2 / (float(m) ** 6 * 4.0 * np.sin(turns) ** 2))


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
        Averaging factors.
    rate : float
        Samples per second: the density ends at half of it.
    kind : str
        As in `transfer`.

    Examples
    --------
    >>> white = deviation_of_density([0.01, 50.0], [2.0, 2.0], [1, 100], rate=100.0)
    >>> white.round(3).tolist()
    [10.0, 1.0]
    """
    known, levels = np.asarray(f, np.float64), np.asarray(density, np.float64)
    if known.ndim != 1 or known.size < 2 or known.shape != levels.shape:
        raise ValueError("need two or more frequencies and as many densities")
    if not (np.all(np.diff(known) > 0) and known[0] > 0 and np.all(levels > 0)):
        raise ValueError("frequencies must ascend from above 0, and densities be positive")
    found = []
    for factor in np.atleast_1d(np.asarray(m)).tolist():
        grid = _grid(factor, rate)
        middle, width = np.sqrt(grid[1:] * grid[:-1]), np.diff(grid)
        passed = transfer(kind, middle, factor, rate)
        found.append(math.sqrt(float(np.sum(_straight(middle, known, levels) * passed * width))))
    return np.array(found)


def _grid(m: int, rate: float) -> Floats:
    """Return frequencies that follow every lobe of the transfer function: steps in log, then even.

    From the tenth lobe on lobes are followed by the phase alone: 24 steps each, up to 2^20 steps.
    """
    first = rate / (m * 1e5)
    low = np.geomspace(first, min(rate / m, rate / 2.0), 4000)
    steps = int(min(24 * m, 1 << 20))
    even = np.linspace(low[-1], rate / 2.0, max(steps, 2))
    return np.unique(np.concatenate([low, even]))


def _straight(f: Floats, known: Floats, levels: Floats) -> Floats:
    """Interpolate, and go on, straight in the logarithms."""
    x, y = np.log(known), np.log(levels)
    at = np.clip(np.searchsorted(x, np.log(f)) - 1, 0, x.size - 2)
    slope = (y[at + 1] - y[at]) / (x[at + 1] - x[at])
    return np.asarray(np.exp(y[at] + slope * (np.log(f) - x[at])))


def density_of_deviation(tau: ArrayLike, deviation: ArrayLike, f: ArrayLike) -> Floats:
    """Return the one-sided density of the sum of power laws nearest to an Allan deviation.

    Parameters
    ----------
    tau, deviation : array_like, shape (k,)
        Points of ADEV in s and in the unit of the rate.
    f : array_like, shape (j,)
        Frequencies in Hz.

    Notes
    -----
    N^2 / tau, (2 ln 2 / pi) B^2, K^2 tau / 3 and 3 Q^2 / tau^2 with none negative, by least squares
    of measured / fitted. A ramp has no density. Q is taken with tau0 = the shortest tau.

    Examples
    --------
    >>> tau = np.array([0.1, 1.0, 10.0])
    >>> density_of_deviation(tau, 3.0 / np.sqrt(tau), [1.0, 5.0]).round(6).tolist()
    [18.0, 18.0]
    """
    from scipy.optimize import nnls

    t, variance = np.asarray(tau, np.float64), np.asarray(deviation, np.float64) ** 2
    if t.shape != variance.shape or t.ndim != 1 or not (np.all(t > 0) and np.all(variance > 0)):
        raise ValueError("need as many positive deviations as positive averaging times")
    lines = np.stack([1.0 / t, np.full_like(t, 2.0 * math.log(2.0) / math.pi), t / 3.0, 3.0 / t**2])
    squares, _ = nnls((lines / variance).T, np.ones_like(t))
    x = np.asarray(f, np.float64)
    two_pi = 2.0 * math.pi
    white, flicker, walk, angle = squares
    both = white + flicker / (two_pi * x) + walk / (two_pi * x) ** 2
    return np.asarray(2.0 * (both + angle * (two_pi * x) ** 2 * float(t.min())))


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
