r"""The period with which noise becomes louder: a radio that sends, a bus that is read, a display.

Such bursts add the same power everywhere in the mean spectrum; what shows them is the spectrum of
the squared innovations, in which they are lines at the reciprocal period and its multiples. Of
noise that is as loud all along each ordinate of it is exponentially distributed, and a line gains
its power over the level beside it in nats: bursts that come at random make that level higher, and
no line. Squares are cut short, so that few loud samples are no comb. Two lines that are left in the
innovations beat with their distance, which is a line of the squares as well: the spectrum is made
level first, and ordinates are cut to what noise has, which leaves bursts as they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from allanscope.explain.candidate import ALPHA
from allanscope.explain.running_level import running_level
from allanscope.median import median

__all__ = ["noise_level_period"]

_LOUDEST = 16.0
"""Square of an innovation, over the mean, from which it counts no more."""
_OF_NOISE = 6.0
"""Power of an ordinate, over the level beside it, that noise exceeds once in 400."""
_BLOCK = 32
"""Ordinates that share a level: a line that wanders fills some of them."""
_FEWEST_PERIODS = 20
"""Of fewer bursts none is regular."""
_FEWEST = 256
"""Ordinates that tell the level beside a line."""
_OF_THE_COMB = 0.3
"""Gain over that of the strongest line from which a lower one may be the fundamental: a burst that
lasts a tenth of the period or less has harmonics of nearly the same strength."""


def noise_level_period(innovations: NDArray[np.float64], rate_hz: float) -> float | None:
    """Return the period in s with which the noise is louder, None where there is none.

    Parameters
    ----------
    innovations : ndarray, shape (n,)
        White noise of about unit variance.
    rate_hz : float
        Of them.

    Examples
    --------
    >>> noise = np.random.default_rng(1).standard_normal(60_000)
    >>> noise_level_period(noise, 100.0) is None
    True
    >>> bursts = np.arange(60_000) % 123 < 5
    >>> round(noise_level_period(noise * np.where(bursts, 3.0, 1.0), 100.0), 3)
    1.23
    """
    n, size = len(innovations), next_fast_len(2 * len(innovations), real=True)
    lowest = int(_FEWEST_PERIODS * size / n)
    if not innovations.any() or size // 2 + 1 < 2 * lowest + _FEWEST:
        return None
    squares = _without_lines(innovations) ** 2
    squares = np.minimum(squares, _LOUDEST * float(squares.mean()))
    power = np.abs(rfft(squares - squares.mean(), size)) ** 2
    gain = np.zeros(len(power))
    gain[lowest:] = power[lowest:] / running_level(power[lowest:])
    strongest = float(gain.max(initial=0.0))
    if strongest < np.log(n / ALPHA):
        return None
    first = int(np.argmax(gain > _OF_THE_COMB * strongest))
    first += int(np.argmax(gain[first : first + size // n + 1]))
    countable = gain[: first**2 // 4]  # which harmonic it is must be sure
    last = int(np.flatnonzero(countable > _OF_THE_COMB * strongest)[-1])
    last += int(np.argmax(gain[last - size // n : last + 1])) - size // n
    return round(last / first) * size / (rate_hz * last)  # the highest harmonic knows it best


def _without_lines(innovations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return innovations whose ordinates are those of white noise, and no larger."""
    ordinates = rfft(innovations)
    power = np.abs(ordinates) ** 2
    starts = np.arange(0, len(power), _BLOCK)
    levels = np.array([median(power[at : at + _BLOCK]) for at in starts]) / np.log(2)
    level = np.repeat(np.maximum(levels, 1e-300), _BLOCK)[: len(power)]
    cut = np.maximum(power / level, _OF_NOISE) / _OF_NOISE
    return np.asarray(irfft(ordinates / np.sqrt(level * cut), len(innovations)))
