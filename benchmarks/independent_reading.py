"""Read the noise of a recording without allanscope: pyarrow, numpy, scipy and allantools only.

What `benchmarks/measured.py` puts beside the loop's numbers must not come from the loop's own
estimators. N is read where the density is flat, as an engineer reads it from a plot: Welch's
density, its medians in sixths of an octave (which no line moves), and the widest run of them that
stays level, well below the corner of a low-pass. OADEV comes from allantools.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import allantools
import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray
from scipy.signal import welch

Array = NDArray[np.float64]

AXES = ("gx", "gy", "gz", "ax", "ay", "az")
TO_OURS = {
    "dps": 1.0,
    "mdps": 1e-3,
    "rad/s": 180 / np.pi,
    "g": 1.0,
    "mg": 1e-3,
    "m/s^2": 1 / 9.80665,
}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
SEGMENTS = 24
"""Stretches that Welch's density is the median of; they overlap by half."""
BIN_SCATTER = 0.40
"""Relative scatter of the median over bins times the root of their number: Welch's segments overlap
by half, the window joins neighbouring bins, and medians are noisier than means."""
MEDIAN_OF_WHITE = 0.979
"""Median over bins of Welch's density (itself a median) of white noise, over the true density."""
LEVEL = 0.05
"""Relative power by which a flat band may be uneven: 2.5 % of N."""
FEWEST_BINS = 4
ONE_DB = 10 ** (-1 / 10)
BURSTY, BURSTS = 0.8, 0.05
"""Median gap over mean gap, and share of long gaps, of a host that reads in bursts."""


@dataclass(frozen=True)
class Samples:
    """A recording: samples in dps and g by axis, as evenly spaced as they can be had.

    Attributes
    ----------
    axes : dict
        Axis to its samples, shape (n,).
    rate_hz : float
        Of rows that follow each other.
    stated_hz : float or None
        What the file states.
    missing : float
        Share of the rows that the times leave out; the gaps are closed.
    """

    axes: dict[str, Array]
    rate_hz: float
    stated_hz: float | None
    missing: float = 0.0

    @property
    def length_s(self) -> float:
        """Length without the gaps."""
        return len(next(iter(self.axes.values()))) / self.rate_hz


@dataclass(frozen=True)
class Reading:
    """What an axis shows by itself, in dps or g.

    Attributes
    ----------
    N, N_error : float
        White noise from the flat band, and its standard error; NaN where no band is flat.
    band : (float, float)
        That band in Hz.
    oadev_1s : float
        Overlapping Allan deviation at 1 s.
    least, least_at_s : float
        The least one, and where.
    """

    N: float
    N_error: float
    band: tuple[float, float]
    oadev_1s: float
    least: float
    least_at_s: float


def samples_of(path: Path) -> Samples:
    """Read a Parquet file of this repository."""
    table = pq.read_table(path)
    facts = json.loads((table.schema.metadata or {}).get(b"allanscope", b"{}"))
    scales = dict(zip(facts.get("axes", ()), facts.get("scale", ()), strict=True))
    axes: dict[str, Array] = {}
    time_s = None
    for name in table.column_names:
        plain, _, unit = name.rstrip("]").partition("[")
        values = table[name].to_numpy().astype(np.float64)
        if plain == "t":
            time_s = values * SECONDS[unit]
        elif plain in AXES:
            axes[plain] = values * (scales[plain] if unit == "lsb" else TO_OURS[unit])
    axes = {axis: axes[axis] for axis in AXES if axis in axes}
    stated = facts.get("rate_hz")
    if time_s is None:
        return Samples(axes, stated, stated)
    gaps = np.diff(time_s)
    mean, median = (time_s[-1] - time_s[0]) / len(gaps), float(np.median(gaps))
    known = stated is not None and abs(median * stated - 1) < 0.1
    if not known and median < BURSTY * mean and np.mean(gaps > 1.5 * median) > BURSTS:
        return Samples(axes, 1 / mean, stated)
    period = float(np.mean(gaps[gaps < 1.5 * median]))
    slots = (time_s[-1] - time_s[0]) / period
    return Samples(axes, 1 / period, stated, max(0.0, 1 - len(gaps) / slots))


def reading_of(x: Array, rate_hz: float) -> Reading:
    """Return what one axis shows."""
    level, error, band = flat_band(x, rate_hz)
    tau, oadev = oadev_of(x, rate_hz)
    least = int(np.argmin(oadev))
    return Reading(
        np.sqrt(level / 2), np.sqrt(level / 2) * error / 2, band,
        float(np.exp(np.interp(0.0, np.log(tau), np.log(oadev)))) if tau[-1] >= 1 else np.nan,
        float(oadev[least]), float(tau[least]),
    )  # fmt: skip


def density_of(x: Array, rate_hz: float) -> tuple[Array, Array]:
    """Return frequencies in Hz and Welch's one-sided density."""
    length = max(256, 2 ** int(np.log2(2 * len(x) / (SEGMENTS + 1))))
    f, s = welch(
        x, rate_hz, nperseg=min(length, len(x)), detrend="linear", average="median"
    )  # fmt: skip
    return f[1:], s[1:]


def flat_band(x: Array, rate_hz: float) -> tuple[float, float, tuple[float, float]]:
    """Return level, relative standard error and limits of the widest flat band of the density.

    Flat means: no median over a bin is off by more than `LEVEL` beyond its own scatter, and
    neither the lower nor the upper third of the band differs from the rest, which is what the rise
    of flicker or the corner of a low-pass would do. Where the density falls towards the Nyquist
    frequency the band ends at half of where it has lost 1 dB. Where no `FEWEST_BINS` are flat the
    level is NaN.
    """
    f, s = density_of(x, rate_hz)
    bins = _bins(f)
    medians = np.array([np.median(s[one]) for one in bins])
    scatter = np.array([BIN_SCATTER / np.sqrt(len(one)) for one in bins])
    top = np.array([f[one[-1]] for one in bins])
    highest = np.inf
    for _ in range(3):
        allowed = int(np.sum(top <= highest))
        found = _widest(f, bins[:allowed], medians, scatter)
        if found is None:
            return np.nan, np.nan, (np.nan, np.nan)
        level, error = _mean(medians[found], scatter[found])
        kept = np.flatnonzero(medians > ONE_DB * level)
        corner = top[kept[-1]]
        if len(bins) - 1 - kept[-1] < 2 or highest <= corner / 2:
            break
        highest = corner / 2
    inside = bins[found]
    return level / MEDIAN_OF_WHITE, error / level, (float(f[inside[0][0]]), float(top[found][-1]))


def _bins(f: Array) -> list[NDArray[np.intp]]:
    """Return the indices in each sixth of an octave, of three frequencies at least."""
    last, bins = int(0.92 * len(f)), []
    start = 2  # the lowest hold what the trend left
    while start + 3 <= last:
        stop = min(last, max(start + 3, int(np.ceil(start * 2 ** (1 / 6)))))
        bins.append(np.arange(start, stop))
        start = stop
    return bins


def _widest(f: Array, bins: list[NDArray[np.intp]], medians: Array, scatter: Array) -> slice | None:
    widest, found = 0.0, None
    for i in range(len(bins)):
        for j in range(i + FEWEST_BINS, len(bins) + 1):
            width = np.log2(f[bins[j - 1][-1]] / f[bins[i][0]])
            if width > widest and _is_flat(medians[i:j], scatter[i:j]):
                widest, found = width, slice(i, j)
    return found


def _is_flat(medians: Array, scatter: Array) -> bool:
    level, _ = _mean(medians, scatter)
    if np.any(np.abs(medians / level - 1) > LEVEL + 2.5 * scatter):
        return False
    third = max(1, len(medians) // 3)
    for part in (slice(0, third), slice(-third, None)):
        rest = np.ones(len(medians), bool)
        rest[part] = False
        (one, error), (other, error_other) = (
            _mean(medians[part], scatter[part]), _mean(medians[rest], scatter[rest]),
        )  # fmt: skip
        if abs(one - other) > LEVEL * level + 1.5 * np.hypot(error, error_other):
            return False
    return True


def _mean(medians: Array, scatter: Array) -> tuple[float, float]:
    """Return the weighted mean and its standard error."""
    weights = scatter**-2
    level = float(np.sum(weights * medians) / weights.sum())
    return level, level / float(np.sqrt(weights.sum()))


def oadev_of(x: Array, rate_hz: float) -> tuple[Array, Array]:
    """Return averaging times in s, to a fifth of the record, and allantools' OADEV."""
    longest = len(x) // 5
    m = np.unique(np.geomspace(1, longest, 60).astype(int))
    tau, oadev, _, _ = allantools.oadev(x, rate_hz, "freq", taus=m / rate_hz)
    return tau, oadev
