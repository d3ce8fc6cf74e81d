"""Certified data: published values, definitions in exact arithmetic, and records with a truth.

Three sources. **Published values**: the two NBS14 data sets with the deviations of NIST SP 1065
section 12.4 and W. J. Riley's tables I to IV, what Stable32 1.60 gives for raw totals and Theo1,
and what SigmaTheta 3.0 gives for PDEV. **Definitions**: every estimator's equation, written out
term by term in Python's own numbers: of fractions they make the exact rational answer. **Records of
our own**: numbers of the congruential generator that SP 1065 uses for its data, so that any machine
makes the same ones without a file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

__all__ = [
    "DEFINITIONS",
    "EFFECTS",
    "PDEV",
    "RATE",
    "TEN",
    "TEN_POINTS",
    "TEN_RAW",
    "THEO1",
    "THOUSAND",
    "THOUSAND_RAW",
    "Truth",
    "integer_record",
    "lehmer",
    "record_with_effects",
    "squares_of_sums",
    "thousand_points",
]

# --- published ------------------------------------------------------------------------------------

TEN_POINTS = (892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0)
"""Frequencies of the 10-point (phase) set of NBS Monograph 140."""

TEN: Mapping[str, Sequence[float]] = {
    "adev": [91.22945, 115.8082],
    "oadev": [91.22945, 85.95287],
    "mdev": [91.22945, 74.78849],
    "tdev": [52.67135, 86.35831],
    "hdev": [70.80608, 116.7980],
    "ohdev": [70.80607, 85.61487],
    "totdev": [91.22945, 93.90379],
    "mtotdev": [75.50203, 75.83606],
    "ttotdev": [43.59112, 87.56794],
    "htotdev": [70.80607, 91.16396],
    "stdev": [100.9770, 102.6039],
}
"""Deviations of `TEN_POINTS` at m = 1, 2; totals without the bias of white FM."""

TEN_RAW: Mapping[str, Sequence[float]] = {"mtotdev": [64.509, 64.794], "ttotdev": [37.244, 74.818]}
"""The totals with their bias, as Stable32 gives them."""

THOUSAND: Mapping[str, Sequence[float]] = {
    "adev": [2.922319e-1, 9.965736e-2, 3.897804e-2],
    "oadev": [2.922319e-1, 9.159953e-2, 3.241343e-2],
    "mdev": [2.922319e-1, 6.172376e-2, 2.170921e-2],
    "tdev": [1.687202e-1, 3.563623e-1, 1.253382],
    "hdev": [2.943883e-1, 1.052754e-1, 3.910860e-2],
    "ohdev": [2.943883e-1, 9.581083e-2, 3.237638e-2],
    "totdev": [2.922319e-1, 9.134743e-2, 3.406530e-2],
    "mtotdev": [2.418528e-1, 6.499161e-2, 2.287774e-2],
    "ttotdev": [1.396338e-1, 3.752293e-1, 1.320847],
    "htotdev": [2.943883e-1, 9.614787e-2, 3.058103e-2],
    "stdev": [2.884664e-1, 9.296352e-2, 3.206656e-2],
}
"""Deviations of `thousand_points` at m = 1, 10, 100."""

THOUSAND_RAW: Mapping[str, Sequence[float]] = {
    "mtotdev": [2.0664e-1, 5.5529e-2, 1.9547e-2],
    "ttotdev": [1.1930e-1, 3.2060e-1, 1.1285],
}

THEO1 = (1.0757e-1, 3.1789e-2, 5.0524e-3)
"""Raw Theo1 of `thousand_points` at m = 10, 100, 1000, as Stable32 gives it."""

PDEV = (
    0.292231878106752,
    0.2144523356425264,
    0.15618112158618463,
    0.11709745745448434,
    0.06902958518983934,
    0.04974970773039839,
    0.03894741733071374,
    0.03086239274137211,
    0.012447414341332683,
)
"""PDEV of `thousand_points` at m = 1, 2, ... 256, as SigmaTheta gives it."""


def lehmer(n: int, state: int = 1234567890) -> NDArray[np.int64]:
    """Return n numbers of the generator of SP 1065: 16807 times the last, modulo 2^31 - 1.

    Examples
    --------
    >>> lehmer(4).tolist()
    [1234567890, 395529916, 1209410747, 633705974]
    """
    numbers, factor = np.array([state], np.int64), 16807
    while numbers.size < n:  # doubled: what comes k later is 16807^k times as large
        numbers = np.append(numbers, numbers * factor % 2147483647)
        factor = factor * factor % 2147483647
    return numbers[:n]


def thousand_points() -> NDArray[np.float64]:
    """Return the 1000 points of NIST SP 1065 section 12.4."""
    return lehmer(1000) / 2147483647


# --- definitions ----------------------------------------------------------------------------------
# x is the phase, one value more than there are rates: numbers of any kind that Python can add, so
# fractions give an exact answer. Each returns the variance and the number of its terms.

Answer = tuple[Any, int]


def _means(x: Sequence[Any], m: int, stride: int) -> list[Any]:
    return [(x[i + m] - x[i]) / m for i in range(0, len(x) - m, stride)]


def _standard(x: Sequence[Any], m: int, stride: int) -> Answer:
    w = _means(x, m, stride)
    mean = sum(w) / len(w)
    return sum((value - mean) ** 2 for value in w) / (len(w) - 1), len(w)


def _allan(x: Sequence[Any], m: int, stride: int) -> Answer:
    terms = [x[i + 2 * m] - 2 * x[i + m] + x[i] for i in range(0, len(x) - 2 * m, stride)]
    return sum(t**2 for t in terms) / (2 * m**2 * len(terms)), len(terms)


def _hadamard(x: Sequence[Any], m: int, stride: int) -> Answer:
    terms = [
        x[i + 3 * m] - 3 * x[i + 2 * m] + 3 * x[i + m] - x[i]
        for i in range(0, len(x) - 3 * m, stride)
    ]
    return sum(t**2 for t in terms) / (6 * m**2 * len(terms)), len(terms)


def _modified(x: Sequence[Any], m: int) -> Answer:
    terms = [
        sum(x[i + j + 2 * m] - 2 * x[i + j + m] + x[i + j] for j in range(m))
        for i in range(len(x) - 3 * m + 1)
    ]
    return sum(t**2 for t in terms) / (2 * m**4 * len(terms)), len(terms)


def _parabolic(x: Sequence[Any], m: int) -> Answer:
    if m == 1:
        return _allan(x, 1, 1)
    terms = [
        sum((m - 1 - 2 * k) * (x[i + k] - x[i + k + m]) for k in range(m))
        for i in range(len(x) - 2 * m)
    ]
    return 18 * sum(t**2 for t in terms) / (m**6 * len(terms)), len(terms)


def _total(x: Sequence[Any], m: int) -> Answer:
    count = len(x)
    image = {i: x[i] for i in range(count)}
    for j in range(1, count - 1):
        image[-j] = 2 * x[0] - x[j]
        image[count - 1 + j] = 2 * x[-1] - x[count - 1 - j]
    terms = [image[i - m] - 2 * image[i] + image[i + m] for i in range(1, count - 1)]
    return sum(t**2 for t in terms) / (2 * m**2 * len(terms)), len(terms)


def _mirrored_windows(values: Sequence[Any], m: int) -> Answer:
    """Mean square of second differences of m-means in detrended windows mirrored to 9m values."""
    total, windows, half = 0 * values[0], len(values) - 3 * m + 1, 3 * m // 2
    for start in range(windows):
        window = values[start : start + 3 * m]
        slope = (sum(window[-half:]) - sum(window[:half])) / half / (3 * m - half)
        window = [value - slope * i for i, value in enumerate(window)]
        sums = [0 * slope]
        for value in (*window[::-1], *window, *window[::-1]):
            sums.append(sums[-1] + value)
        total += sum(
            (sums[j + 3 * m] - 3 * sums[j + 2 * m] + 3 * sums[j + m] - sums[j]) ** 2
            for j in range(6 * m)
        )
    return total / (6 * m * m**2 * windows), windows


def _modified_total(x: Sequence[Any], m: int) -> Answer:
    mean, windows = _mirrored_windows(x, m)
    return mean / (2 * m**2), windows


def _hadamard_total(x: Sequence[Any], m: int) -> Answer:
    if m == 1:
        return _hadamard(x, 1, 1)
    mean, windows = _mirrored_windows([b - a for a, b in pairwise(x)], m)
    return mean / 6, windows


def _theo1(x: Sequence[Any], m: int) -> Answer:
    terms = [
        sum(
            ((x[i] - x[i - d + m // 2]) + (x[i + m] - x[i + d + m // 2])) ** 2 / (m // 2 - d)
            for d in range(m // 2)
        )
        for i in range(len(x) - m)
    ]
    return sum(terms) * 4 / (3 * m**2 * len(terms)), len(terms)


def _theobr(x: Sequence[Any], m: int) -> Answer:
    ratios = [
        _allan(x, 9 + 3 * i, 1)[0] / _theo1(x, 12 + 4 * i)[0] for i in range(len(x) // 30 - 2)
    ]
    raw, windows = _theo1(x, m)
    return raw * sum(ratios) / len(ratios), windows


def _theoh(x: Sequence[Any], m: int) -> Answer:
    return _allan(x, m, 1) if 10 * m <= len(x) - 1 else _theobr(x, m)


def _as_time(answer: Answer, m: int) -> Answer:
    return answer[0] * m**2 / 3, answer[1]


DEFINITIONS: Mapping[str, Callable[[Sequence[Any], int], Answer]] = {
    "stdev": lambda x, m: _standard(x, m, m),
    "ostdev": lambda x, m: _standard(x, m, 1),
    "adev": lambda x, m: _allan(x, m, m),
    "oadev": lambda x, m: _allan(x, m, 1),
    "hdev": lambda x, m: _hadamard(x, m, m),
    "ohdev": lambda x, m: _hadamard(x, m, 1),
    "mdev": _modified,
    "tdev": lambda x, m: _as_time(_modified(x, m), m),
    "totdev": _total,
    "mtotdev": _modified_total,
    "ttotdev": lambda x, m: _as_time(_modified_total(x, m), m),
    "htotdev": _hadamard_total,
    "theo1": _theo1,
    "theobr": _theobr,
    "theoh": _theoh,
    "pdev": _parabolic,
}
"""Variance and number of terms of every estimator, with tau0 = 1, from phase and m."""


def squares_of_sums(rates: NDArray[np.int64], m: int, stride: int) -> dict[str, Fraction]:
    """Return the sums of squares of which a streamed variance is made, exactly.

    Parameters
    ----------
    rates : ndarray of int64, shape (n,)
        Samples.
    m : int
        Averaging factor, a multiple of `stride`.
    stride : int
        Step between the terms of the overlapping estimators: 1, or where they are thinned 2^L.

    Returns
    -------
    dict
        For oadev, ohdev, mdev, pdev, adev, hdev, and totdev without the squares of oadev.
    """
    x = np.append(0, np.cumsum(rates))
    z = np.append(0, np.cumsum(x))  # of all phases before
    q = np.append(0, np.cumsum(2 * z[:-1] + x))  # twice the trapezoids
    inclusive = z if stride == 1 else z[:-1]  # SP 1065 counts one term more where all are there
    x, z, q = x[::stride], z[:-1][::stride], q[:-1][::stride]
    s, k = inclusive[::stride], m // stride
    d = x[2 * k :] - 2 * x[k:-k] + x[: -2 * k] if x.size > 2 * k else x[:0]
    h = _third(x, k)
    r = m * (z[2 * k :] - z[: -2 * k]) - (q[2 * k :] - 2 * q[k:-k] + q[: -2 * k])
    count = x.size - 1
    end = np.concatenate([2 * x[0] - x[count - 1 : 0 : -1], x, 2 * x[-1] - x[-2:0:-1]])
    at = np.arange(1, count) + count - 1
    total = end[at - k] - 2 * end[at] + end[at + k] if k <= count else x[:0]
    return {
        "oadev": _sum_of_squares(d),
        "ohdev": _sum_of_squares(h),
        "mdev": _sum_of_squares(_third(s, k)),
        "pdev": _sum_of_squares(r[: max(x.size - 2 * k, 0)]) / 4,
        "adev": _sum_of_squares(d[::k]),
        "hdev": _sum_of_squares(h[::k]),
        "totdev": _sum_of_squares(total) - _sum_of_squares(d),
    }


def _third(s: NDArray[np.int64], k: int) -> NDArray[np.int64]:
    if s.size <= 3 * k:
        return s[:0]
    return np.asarray(s[3 * k :] - 3 * s[2 * k : -k] + 3 * s[k : -2 * k] - s[: -3 * k])


def _sum_of_squares(terms: NDArray[np.int64]) -> Fraction:
    return Fraction(sum(t * t for t in terms.tolist()))


# --- records --------------------------------------------------------------------------------------


def integer_record(n: int) -> NDArray[np.int64]:
    """Return n whole numbers from -8 to 8, each as likely as any other.

    Small ones: the sums of their squares stay whole numbers that a double holds.
    """
    return np.asarray((lehmer(n) >> 20) % 17 - 8)


@dataclass(frozen=True, slots=True)
class Truth:
    """What is in one axis of `record_with_effects`.

    Attributes
    ----------
    N, K : float
        White noise and random walk, in counts/sqrt(Hz) and counts/sqrt(s).
    kind : str
        Of the one effect; empty for none.
    parameters : mapping
        Of the effect; an amplitude or a size in counts.
    """

    N: float
    K: float = 0.0
    kind: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)


RATE = 104.0
_ROWS = 62_400
_WHITE, _WALK = 8.0, 0.07
"""Standard deviation of the white noise, and of the steps of the random walk, in counts."""

_LINE_HZ, _LINE = 12.5, 6.0
_STEP_AT, _STEP = 40_000, 5.0
_KNOCKS = {1000: 150, 7777: -150, 20000: 150, 30001: 150, 41234: -200, 50000: 150, 60000: 150}

_N = float(np.sqrt((_WHITE**2 + 1 / 12) / RATE))

EFFECTS: Mapping[str, Truth] = {
    "gx": Truth(_N),
    "gy": Truth(_N, kind="sinusoid", parameters={"frequency": _LINE_HZ, "amplitude": _LINE}),
    "gz": Truth(_N, K=float(_WALK * np.sqrt(RATE))),
    "ax": Truth(_N, kind="step", parameters={"time": _STEP_AT / RATE, "size": _STEP}),
    "ay": Truth(_N, kind="outliers", parameters={"count": len(_KNOCKS)}),
}
"""The truth about `record_with_effects`, which whoever analyses the record is not told."""


def record_with_effects() -> NDArray[np.int16]:
    """Return ten minutes of five axes at 104 Hz, shape (62400, 5): noise, and one effect each.

    The converter rounds, which adds 1/12 to the variance of the white noise.
    """
    normal = ndtri(lehmer(6 * _ROWS) / 2147483647).reshape(6, _ROWS)
    axes = _WHITE * normal[:5]
    axes[1] += _LINE * np.sin(2 * np.pi * _LINE_HZ / RATE * np.arange(_ROWS))
    axes[2] += _WALK * np.cumsum(normal[5])
    axes[3, _STEP_AT:] += _STEP
    axes[4, list(_KNOCKS)] += list(_KNOCKS.values())
    return np.rint(axes).astype(np.int16).T.copy()
