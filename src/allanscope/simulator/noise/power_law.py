"""Noise of every power law: white noise, integrated or differenced a fractional number of times.

A rate whose two-sided density is ``h |f|^alpha`` is white noise integrated ``d = -alpha / 2``
times. The whole part of d is plain sums or differences. The fractional part is a bank of
first-order filters that share one input:

The filter ``(1 - z^-1)^-d`` with 0 < d < 1 turns white noise into noise of density
``|2 sin(pi f t0)|^-2d``, the ARFIMA(0, d, 0) process; d = 1/2 is flicker. Its impulse response is a
mixture of decaying exponentials,

    h_k = Gamma(k + d) / (Gamma(d) k!) = sin(pi d)/pi  int_0^1 p^k p^(d-1) (1-p)^(-d) dp,

and with p = 1/(1 + e^u) the integral becomes one over the whole line,

    h_k = sin(pi d)/pi  int  e^((1-d) u) / (1 + e^u)  p(u)^k  du,

of a function so smooth that the trapezoidal rule converges exponentially. Each of its nodes is one
pole p with one positive weight, so 20 multiply-adds a sample make flicker noise over eleven
decades, from a single random number a sample. Two tails are cut off and put back in one lump:

* slow nodes, below ``-log(longest)``: at all times of interest they are integrators; their weight
  goes to the slowest pole that is kept;
* fast nodes, above `U_HIGH`: their poles are zero for all purposes; what is missing from h_0 = 1
  goes straight from input to output.

With nodes 1.5 apart the Allan variance of the result is within 0.1 % of the exact discrete one
at every tau from 1 sample to a hundredth of `longest` (computed, not sampled:
``tests/simulator/test_simulator_noise.py``). Nodes 2.0 apart would give 0.9 %.

The named noises at the end translate the coefficients of IEEE 952 into `h`.

Sources: J. R. M. Hosking, Fractional differencing, Biometrika 68 (1981) 165, for the filter;
L. N. Trefethen and J. A. C. Weideman, The exponentially convergent trapezoidal rule, SIAM Review 56
(2014) 385, for the rule.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from allanscope.compiled import Pointer, kernel

__all__ = [
    "Flicker",
    "FlickerPhase",
    "FlickerWalk",
    "PowerLaw",
    "RandomRun",
    "RandomWalk",
    "White",
    "WhitePhase",
    "filter_bank",
    "pole_bank",
]

LONGEST_S = 1e7
"""Time constant of the slowest pole: four months, so that a day is far from where 1/f ends."""
NODE_SPACING = 1.5
U_HIGH = 4.0
"""Fastest pole: 1/(1 + e^4) = 0.018."""


def pole_bank(d: float, longest: float) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return poles, weights and direct gain of the filter (1 - z^-1)^-d.

    Parameters
    ----------
    d : float
        Order of integration, 0 < d < 1.
    longest : float
        Time constant of the slowest pole in samples. Beyond it the density levels off.

    Returns
    -------
    poles, weights : ndarray, shape (k,)
        ``h_j = sum(weights * poles**j)`` for j > 0.
    direct : float
        What ``h_0 = 1`` needs beyond the sum of the weights.
    """
    if not 0.0 < d < 1.0:
        raise ValueError(f"the order of a fractional integral is between 0 and 1, got {d}")
    u = np.arange(-np.log(longest), U_HIGH + NODE_SPACING / 2, NODE_SPACING)
    scale = NODE_SPACING * np.sin(np.pi * d) / np.pi
    poles = 1.0 / (1.0 + np.exp(u))
    weights = scale * np.exp((1.0 - d) * u) / (1.0 + np.exp(u))
    weights[0] += scale * np.exp((1.0 - d) * u[0]) / np.expm1((1.0 - d) * NODE_SPACING)
    return poles, weights, 1.0 - float(weights.sum())


class FractionalIntegral:
    """The filter as a stream, in its stationary state from the first sample on.

    Parameters
    ----------
    d : float
        Order of integration, 0 < d < 1.
    longest : float
        Time constant of the slowest pole in samples.
    rng : Generator
        Draws the initial state, as the history before the first sample would have left it.
    """

    def __init__(self, d: float, longest: float, rng: Generator) -> None:
        self.poles, self.weights, self.direct = pole_bank(d, longest)
        self._state = _stationary_state(self.poles, rng)

    def apply(self, white: NDArray[np.float64]) -> None:
        """Filter unit white noise in place."""
        count, state = len(self.poles), self._state
        filter_bank(self.poles, self.weights, count, self.direct, state, white, len(white))


def _stationary_state(poles: NDArray[np.float64], rng: Generator) -> NDArray[np.float64]:
    """Draw the states of filters that have run on one white input for ever.

    Their covariance is 1 / (1 - p_i p_j), near-singular because neighbours are nearly the same
    process; hence the eigenvalues of the correlation matrix and not a Cholesky factor.
    """
    covariance = 1.0 / (1.0 - np.outer(poles, poles))
    spread = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(spread, spread))
    draw: NDArray[np.float64] = np.sqrt(np.clip(values, 0.0, None)) * rng.standard_normal(
        len(poles)
    )
    state: NDArray[np.float64] = spread * (vectors @ draw)
    return state


filter_bank = kernel(
    "filter_bank",
    *(Pointer(np.float64, 1), Pointer(np.float64, 1), int, float),
    *(Pointer(np.float64, 1, written=True), Pointer(np.float64, 1, written=True), int),
)
"""Filter samples in place with first-order filters that share one input."""


class PowerLaw:
    """Rate noise with two-sided density ``h |f|^alpha``, exactly that of a power of a difference.

    ``y = sigma (1 - z^-1)^-d w`` with white w of unit variance, d = -alpha / 2, has the density

        S(f) = sigma^2 t0 |2 sin(pi f t0)|^alpha  ->  h |f|^alpha   for f << 1/t0,

    so that sigma^2 = h / ((2 pi)^alpha t0^(1 + alpha)).

    Parameters
    ----------
    alpha : float
        Exponent, from -4 (random run) to 2 (white phase).
    h : float
        Level: density at 1 Hz, unit^2 / Hz, two-sided.
    rate_hz : float
        Samples per second.
    rng : Generator
        Source of randomness, used by this process alone.

    Raises
    ------
    ValueError
        If alpha is out of range or the level negative.

    Examples
    --------
    >>> white = PowerLaw(0.0, h=4.0, rate_hz=100.0, rng=np.random.default_rng(1))
    >>> white.sigma  # sqrt(h * rate)
    20.0
    """

    def __init__(self, alpha: float, h: float, rate_hz: float, rng: Generator) -> None:
        if not -4.0 <= alpha <= 2.0:
            raise ValueError(f"the exponent of a power law is from -4 to 2, got {alpha}")
        if not h >= 0.0:
            raise ValueError(f"the level of a noise is 0 or more, got {h}")
        self.sigma = math.sqrt(h * rate_hz) * (rate_hz / (2.0 * math.pi)) ** (alpha / 2.0)
        self._rng = rng
        whole = math.floor(-alpha / 2.0)
        fraction = -alpha / 2.0 - whole
        self._fractional = (
            FractionalIntegral(fraction, LONGEST_S * rate_hz, rng) if fraction else None
        )
        self._sums = [0.0] * max(whole, 0)
        self._last = self._next(1) if whole == -1 else None

    def take(self, n: int) -> NDArray[np.float64]:
        """Return the next `n` samples, shape (n,), in the unit of the axis."""
        samples = self._next(n)
        if self._last is not None:
            longer = np.concatenate((self._last, samples))
            self._last = longer[-1:]
            samples = np.diff(longer)
        if n:
            for order, total in enumerate(self._sums):
                samples[0] += total
                np.cumsum(samples, out=samples)
                self._sums[order] = float(samples[-1])
        return samples

    def _next(self, n: int) -> NDArray[np.float64]:
        """Return the next samples before they are summed or differenced."""
        samples = self._rng.standard_normal(n)
        if self._fractional is not None:
            self._fractional.apply(samples)
        samples *= self.sigma
        return samples


class WhitePhase(PowerLaw):
    """The difference of white angle noise: y = (q_k - q_(k-1)) / t0, q of standard deviation Q.

    S(f) = (2 pi f)^2 Q^2 t0 for f << 1/t0 (two-sided);  AVAR(tau) = 3 Q^2 / tau^2, exact.
    This is what a sensor of angle increments has. Rounding of a *rate* output makes white noise.

    Parameters
    ----------
    Q : float
        Coefficient, unit s (deg for a gyro, g s for an accelerometer).
    rate_hz, rng
        See `PowerLaw`.
    """

    def __init__(self, Q: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(2.0, (2.0 * math.pi * Q) ** 2 / rate_hz, rate_hz, rng)


class FlickerPhase(PowerLaw):
    """The difference of flicker angle noise.

    S(f) = 2 pi f P^2 for f << 1/t0 (two-sided);
    AVAR(tau) = 2 P^2 / (pi tau^2) (4 h_m - h_2m), h_m = 1 + 1/3 + ... + 1/(2m - 1), exact: as
    tau^-2 but for a logarithm. The modified Allan variance tells it from white phase.

    Parameters
    ----------
    P : float
        Flicker coefficient of the angle, unit s.
    rate_hz, rng
        See `PowerLaw`.
    """

    def __init__(self, P: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(1.0, 2.0 * math.pi * P**2, rate_hz, rng)


class White(PowerLaw):
    """Samples that know nothing of one another.

    S(f) = N^2 (two-sided);  AVAR(tau) = N^2 / tau, exact;  standard deviation N / sqrt(t0).

    Parameters
    ----------
    N : float
        Coefficient, unit/sqrt(Hz) two-sided: ADEV at 1 s. A density read from a one-sided spectrum
        or a datasheet is sqrt(2) larger.
    rate_hz, rng
        See `PowerLaw`.
    """

    def __init__(self, N: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(0.0, N**2, rate_hz, rng)


class Flicker(PowerLaw):
    """1/f noise: ARFIMA(0, 1/2, 0).

    S(f) = B^2 / (2 pi f) for f << 1/t0 (two-sided), in discrete time B^2 t0 / (2 sin(pi f t0));
    AVAR(tau) = (2 ln 2 / pi) B^2 for tau >> t0. At m = tau / t0 = 1, 2, 4, 8 the discrete process
    has 1.443, 1.154, 1.050, 1.015 times that. The innovation has standard deviation B.

    Parameters
    ----------
    B : float
        Coefficient in the unit of the axis; the floor of ADEV is 0.664 B.
    rate_hz, rng
        See `PowerLaw`.
    """

    def __init__(self, B: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(-1.0, B**2 / (2.0 * math.pi), rate_hz, rng)


class RandomWalk(PowerLaw):
    """Sum of white increments K sqrt(t0) w, starting from zero.

    S(f) = (K / 2 pi f)^2 (two-sided);  AVAR(tau) = K^2 tau / 3 (1 + 1 / (2 m^2)), exact.

    Parameters
    ----------
    K : float
        Coefficient, unit/sqrt(s): standard deviation of the change in 1 s.
    rate_hz, rng
        See `PowerLaw`.
    """

    def __init__(self, K: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(-2.0, (K / (2.0 * math.pi)) ** 2, rate_hz, rng)


class FlickerWalk(PowerLaw):
    """The sum of a flicker rate of change.

    S(f) = F^2 / (2 pi f)^3 (two-sided). The Allan variance has no limit as the record grows; the
    Hadamard variance rises as tau^2.

    Parameters
    ----------
    F : float
        Flicker coefficient of the rate of change, unit/s.
    rate_hz, rng
        See `PowerLaw`.
    """

    def __init__(self, F: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(-3.0, F**2 / (2.0 * math.pi) ** 3, rate_hz, rng)


class RandomRun(PowerLaw):
    """The double sum of white noise.

    S(f) = D^2 / (2 pi f)^4 (two-sided). The Allan variance has no limit as the record grows; the
    Hadamard variance rises as tau^3.

    Parameters
    ----------
    D : float
        Random walk coefficient of the rate of change, unit/s^(3/2).
    rate_hz, rng
        See `PowerLaw`.
    """

    def __init__(self, D: float, rate_hz: float, rng: Generator) -> None:
        super().__init__(-4.0, D**2 / (2.0 * math.pi) ** 4, rate_hz, rng)
