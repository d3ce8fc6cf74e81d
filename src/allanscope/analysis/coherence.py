"""What axes have in common: the magnitude-squared coherence of each band, and its cause.

Axes that are coherent in a band have one cause there, whatever its name. Of two axes of which one
couples into the other, noise of equal colour does not tell which; a line or a step does, that one
of them has alone, or that the other has in just the proportion of the leak.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.fft import prev_fast_len, rfft

from allanscope.analysis.findings import Finding, line_of
from allanscope.analysis.line_origin import reduced, without_trend
from allanscope.history import Record
from allanscope.labels import kind_name
from allanscope.median import median
from allanscope.quantities import number

__all__ = ["CoherentBand", "Leak", "common_of", "leak_of"]

Array = NDArray[np.float64]

_FALSE = 1e-3
"""Chance of any coherent band of a record whose axes have nothing in common."""
_FIRST_BIN = 8
_PER_OCTAVE = 2
_FEWEST_BINS = 24
_SMOOTHED = 10
"""Bands in an octave in which a spectrum is made white."""
_LOUD = 12.0
"""Power of a bin over the noise around it beyond which it is a line, with a finding of its own."""
_OF_THE_TAPER = 35 / 18
"""Variance of a sum over bins tapered by a Hann window over that of independent ones."""
_DECIDED_NATS = 5.0
_FITS_NATS = 8.0
"""Misfit that the better direction may have."""


@dataclass(frozen=True, slots=True)
class CoherentBand:
    """A range of frequencies in which axes are coherent.

    Attributes
    ----------
    low_hz, high_hz : float
    axes : tuple of str
    coherence : float
        Largest magnitude-squared coherence of two of them in one band.
    limit : float
        What two axes without anything in common exceed in one of 1000 records, in any band.
    cause : str
        The finding that has these axes, in a word; empty where none has.
    """

    low_hz: float
    high_hz: float
    axes: tuple[str, ...]
    coherence: float
    limit: float
    cause: str = ""

    @property
    def words(self) -> str:
        """All of it in a phrase."""
        band = f"{number(self.low_hz, 2)} to {number(self.high_hz, 2)} Hz"
        size = f"coherence {number(self.coherence, 2)} (limit {number(self.limit, 2)})"
        return f"{band}: {size}, {self.cause or 'one common cause, not identified'}"


@dataclass(frozen=True, slots=True)
class Leak:
    """The direction of a cross-coupling that its noise does not tell.

    Attributes
    ----------
    source, target : str
    margin_nats : float
        Log-likelihood over the other direction.
    words : str
    """

    source: str
    target: str
    margin_nats: float
    words: str


def common_of(
    record: Record, findings: Sequence[Finding] = (), *, threads: int = 1
) -> tuple[CoherentBand, ...]:
    """Return the bands in which axes have one cause, from low to high frequencies.

    Parameters
    ----------
    record : Record
        Its longest piece without a gap is looked at, but for at most 1 % of a long one.
    findings : sequence of Finding
        Among which the cause is looked for.
    threads : int
        In which the spectra are computed.

    Notes
    -----
    Of n independent averages the coherence of nothing exceeds x with a chance of (1 - x)^(n - 1)
    (Carter, Knapp and Nuttall 1973).
    """
    first, last = max(record.segments.tolist(), key=lambda s: s[1] - s[0], default=(0, 0))
    # A length with a large prime factor, as most records have, takes several times as long.
    n = prev_fast_len(last - first) if last > first else 0
    values = record.values[first : first + n]
    moving = [k for k in range(len(record.axes)) if len(values) and np.ptp(values[:, k]) > 0]
    if len(moving) < 2 or n < 8 * _FEWEST_BINS:
        return ()
    with ThreadPoolExecutor(threads) as pool:
        window = np.hanning(n)
        white, power, quiet = map(
            np.array,
            zip(*pool.map(lambda k: _whitened(values[:, k], window), moving), strict=True),
        )
    white, power, used = white * quiet, power * quiet, quiet.astype(np.float64)
    steps = max(1, int(_PER_OCTAVE * math.log2((n // 2) / _FIRST_BIN)))
    edges = np.unique(np.geomspace(_FIRST_BIN, n // 2, steps + 1).astype(int))
    bands = [(a, b) for a, b in pairwise(edges) if b - a >= _FEWEST_BINS]
    pairs = list(combinations(range(len(moving)), 2))
    found: list[CoherentBand] = []
    for low, high in bands:
        # Of each pair of axes, over the bins that are lines of neither.
        x, p, q = (one[:, low:high] for one in (white, power, used))
        cross, own, bins = np.abs(x.conj() @ x.T) ** 2, p @ q.T, q @ q.T
        groups = {k: {k} for k in range(len(moving))}
        best, limit = 0.0, 0.0
        for i, j in pairs:
            averages = float(bins[i, j]) / _OF_THE_TAPER
            if averages < _FEWEST_BINS / 4:
                continue
            coherence = float(cross[i, j] / (own[i, j] * own[j, i]))
            least = 1 - (_FALSE / (len(pairs) * len(bands))) ** (1 / (averages - 1))
            limit = max(limit, least)
            if coherence > least:
                best = max(best, coherence)
                joined = groups[i] | groups[j]
                for k in joined:
                    groups[k] = joined
        for group in {tuple(sorted(one)) for one in groups.values() if len(one) > 1}:
            axes = tuple(record.axes[moving[k]] for k in group)
            ends = low * record.rate_hz / n, high * record.rate_hz / n
            found.append(CoherentBand(*ends, axes, best, limit))
    return tuple(_with_cause(one, findings) for one in _joined(found))


def _whitened(
    values: Array, window: Array
) -> tuple[NDArray[np.complex128], Array, NDArray[np.bool_]]:
    """Return the spectrum of an axis made white, its power, and the bins that are no lines."""
    spectrum = np.asarray(rfft(without_trend(values) * window), np.complex128)
    power = np.abs(spectrum) ** 2
    steps = max(1, int(_SMOOTHED * math.log2(len(power) / 4)))
    edges = np.unique(np.r_[1, np.geomspace(4, len(power), steps).astype(int)])
    level = np.ones(len(power))
    for low, high in pairwise(edges):
        level[low:high] = max(median(power[low:high]) / math.log(2), 1e-300)
    white = spectrum / np.sqrt(level)
    power = np.abs(white) ** 2
    return white, power, power < _LOUD


def _joined(found: Sequence[CoherentBand]) -> list[CoherentBand]:
    """Join neighbouring bands of the same axes."""
    out: list[CoherentBand] = []
    for one in found:
        before = next((k for k in out if k.axes == one.axes and k.high_hz == one.low_hz), None)
        if before is None:
            out.append(one)
        else:
            size, limit = max((before.coherence, before.limit), (one.coherence, one.limit))
            out[out.index(before)] = CoherentBand(before.low_hz, one.high_hz, one.axes, size, limit)
    return out


def _with_cause(one: CoherentBand, findings: Sequence[Finding]) -> CoherentBand:
    """Return it with the finding that has these axes and is no line, if there is one."""
    for finding in findings:
        sources = {
            m.effect.parameters[k].value
            for m in finding.members
            for k in ("source",)
            if k in m.effect.parameters
        }
        on = {*finding.axes, *sources}
        if line_of(finding.members[0].effect) is None and set(one.axes) <= on:
            cause = kind_name(finding.kind)
            return CoherentBand(one.low_hz, one.high_hz, one.axes, one.coherence, one.limit, cause)
    return one


def leak_of(
    finding: Finding, lines: Mapping[float, float], record: Record, rate_hz: float
) -> Leak | None:
    """Return the direction of a cross-coupling as lines tell it; None where nothing does.

    If y takes c from x, a line of x is in y at c times its amplitude, and a line of y alone is not
    in x at all. In the other direction it is the other way round.

    Parameters
    ----------
    finding : Finding
        The coupling, of which both axes list the other as the source.
    lines : mapping
        Frequency to width in Hz, of the lines of either axis.
    record : Record
        Rows of all axes.
    rate_hz : float
        True sample rate.
    """
    slopes = {
        (str(m.effect.parameters["source"].value), m.axis): float(
            m.effect.parameters["slope"].value
        )
        for m in finding.members
        if {"source", "slope"} <= set(m.effect.parameters)
    }
    (pair, forth) = next(iter(slopes.items()), (("", ""), 0.0))
    if len(slopes) != 2 or pair[::-1] not in slopes or not lines:
        return None
    x, y = (record.axes.index(name) for name in pair)
    back = slopes[pair[::-1]]
    numbers = record.start_s * rate_hz + 0.5 * (record.stride - 1)
    misfits = np.zeros(2)
    for hz, width in lines.items():
        sums = reduced(record.values[:, [x, y]], numbers, rate_hz, hz, width, None)
        if sums is None:
            continue
        spectrum = np.fft.fft(sums.sums, axis=1)
        at = int(np.argmax((np.abs(spectrum) ** 2 / sums.level[:, None]).sum(axis=0)))
        a, b = spectrum[:, at]
        va, vb = sums.level
        misfits += (
            min(abs(b - forth * a) ** 2 / (vb + forth**2 * va), abs(a) ** 2 / va),
            min(abs(a - back * b) ** 2 / (va + back**2 * vb), abs(b) ** 2 / vb),
        )
    margin = float(misfits[1] - misfits[0])
    if abs(margin) < _DECIDED_NATS or float(misfits.min()) > _FITS_NATS * len(lines):
        return None
    source, target = pair if margin > 0 else pair[::-1]
    words = f"{source} couples into {target}: decided by {'a line' if len(lines) == 1 else 'lines'}"
    return Leak(source, target, abs(margin), words)
