r"""A line that drifts: its amplitude, its phase or its frequency changes through the record.

The commonest thing in measured data: a fan, a pump or a building that is excited by the traffic.
In the spectrum it is a cluster of ordinates whose form is that of its history, which no shape of a
few numbers describes; in time it is a tone

.. math:: x(t) = \mathrm{Re}\, a(t) e^{2 \pi i f_0 t}

whose complex amplitude a is smooth over a block of a quarter of the reciprocal width of the
cluster, and of a twentieth of the longest stretch where it is there in a part of the record only
(a compressor that is switched on and off). That is also how it is judged: the amplitude in each
block is predicted from its two neighbours, which must hold power in the block, and what the
prediction gains there over noise of the same power, or over a constant line where that does better,
is the held-out gain; over noise also where it does as well, for it was refused before.
In the model it is a component with the measured distribution of its power (`LineProfile`).

It is no `sinusoid`: that has one amplitude and phase all along. It is no `narrowband`: that is
noise, as loud in every part of the record as Gaussian noise of its bandwidth is. A tone that goes
through a range wider than a tenth of its frequency is `unexplained`: a sweep is no line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate, HeldOut, error_of_sum
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.presence import Presence, presence_of
from allanscope.explain.series import in_time
from allanscope.explain.stationarity import demodulate
from allanscope.explain.view import Span, View
from allanscope.noise.components import LineProfile
from allanscope.noise.grid import Grid
from allanscope.quantities import CHI_SQUARE_MEDIAN, measured, periods

Array = NDArray[np.float64]

_WIDEST = 0.1
"""Width over frequency beyond which a tone sweeps."""
_HOLDS = 0.9
"""Share of the power that is called its bandwidth."""
_RESOLVED = 0.8
"""Standard error of the width of a line without noise, times the length of the record."""
_WIDER = 0.4
"""Ordinates by which the record makes a line wider, by simulation of lines that swing."""
_SHARES = 96
"""Sub-bands of a profile."""
_AROUND, _LOUD = 5, 4.0
"""Ordinates over which the power is averaged, and that mean over the noise: one in 10^3 by chance
within a range that holds a tone."""
_LEAST = 30.0
"""Excess of a cluster over the noise, in ordinates of noise."""
_CORE = 0.7
"""Share of the power of a part that its core has, where a line stands on the slope of a band."""
_BRIDGED = 100
"""Ordinates between two loud ones of one line, the sidebands of what is modulated; never more than
a fiftieth of its frequency."""
_VALLEY, _VALLEYS, _DEEP = 24, 6.0, 5.0
"""Ordinates over which the density is averaged where lines touch, by how many more it is if there
are e times as many, and the factor by which it falls between two of them."""
_TIMES, _FADED = 16, 0.1
"""Parts of the record in nine of ten of which a line that touches another must be, and the share of
its mean power from which it is."""
_MARGIN = 2
"""Ordinates on each side of a cluster that belong to it; clusters that would share one are one."""
_BESIDE, _CLEARLY, _ABOVE = 3, 4.0, 10.0
"""Widths of a cluster that are looked at on each side; standard errors of their median that are
nothing; factor by which the power of a line exceeds theirs."""
_SURELY = 3.0
"""Held-out gain in standard errors: a piece of a weak sweep is predictable for a while too."""
_BLOCK = 0.25
"""Length of a block times the bandwidth."""
_PARTS = 10
"""Blocks, and parts of the surroundings, from which the scatter of a quantity is taken."""


@dataclass(frozen=True)
class DriftingLine(EffectKind):
    """A tone whose amplitude, phase or frequency changes.

    Attributes
    ----------
    share_of_time, present : float, tuple of (float, float)
        Share of the record, and from and until when in s, where it is there in a part of it only;
        None where it is there all along.
    """

    frequency: Estimate
    bandwidth: Estimate
    sigma: Estimate
    frequency_first: float
    frequency_last: float
    amplitude_least: float
    amplitude_most: float
    share_of_time: float | None = None
    present: tuple[Span, ...] | None = None

    kind = "drifting_line"
    meaning = "a tone whose amplitude, phase or frequency changes slowly"
    phrase = "drifting line around {frequency}, {sigma} rms"
    as_cause = "a drifting line around {frequency} Hz"
    is_counted = True
    is_line = True
    sized_by = "sigma"
    located_by = "frequency"
    shared_by = "frequency"
    confused_with: ClassVar[Mapping[str, str]] = {
        "sinusoid": "its amplitude and phase are the same in every part of the record",
        "narrowband": "its power is that of noise in every part of the record",
        "unexplained": "a sweep goes through a range wider than a tenth of its frequency",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        f = self.frequency.value
        line = f"a line around {f:.5g} Hz{periods(f)}"
        if self.present is not None and self.share_of_time is not None:
            when = Presence(self.share_of_time, self.present)
            then = self.sigma.value / float(np.sqrt(self.share_of_time))
            return (
                f"{line} {when.words}; its rms amplitude is "
                f"{measured(then, unit=self.sigma.unit)} then, {self.sigma.text} over the record"
            )
        return (
            f"{line} drifts within "
            f"{self.bandwidth.value:.3g} Hz; its rms amplitude is {self.sigma.text} ("
            f"{measured(self.amplitude_least, unit=self.sigma.unit)} to "
            f"{measured(self.amplitude_most, unit=self.sigma.unit)} over tenths of the record)"
        )

    @property
    def spans(self) -> tuple[Span, ...]:
        """From and until when it is there, where that is a part of the record only."""
        return self.present or ()

    @classmethod
    def propose(cls, view: View) -> tuple[()]:
        """Return nothing: it is what lines and bands turn out to be (`moves.resolve_tones`)."""
        del view
        return ()

    def is_same(self, other: DriftingLine, grid: Grid) -> bool:
        """Return whether another line is the same hypothesis."""
        del grid
        apart = abs(self.frequency.value - other.frequency.value)
        return apart < max(self.bandwidth.value, other.bandwidth.value)


@dataclass(frozen=True)
class Cluster:
    """A run of ordinates above the noise.

    Attributes
    ----------
    first, stop : int
        Ordinates (0 stands for k = 1).
    """

    first: int
    stop: int


def range_of(view: View, low: float, high: float) -> Cluster:
    """Return the ordinates between two frequencies in Hz."""
    unit = view.grid.rate_hz / (2 * view.grid.n)
    first = min(max(0, round(low / unit) - 1), view.grid.n - 2)
    return Cluster(first, max(first + 1, min(view.grid.n - 1, round(high / unit))))


def excess(view: View, *parts: Cluster) -> float:
    """Return the power of clusters above the noise."""
    inside = [slice(c.first, c.stop) for c in parts]
    return float(sum(np.sum(view.squares[s] - view.spectrum.ordinates[s]) for s in inside))


def clusters(view: View, low: float, high: float) -> list[Cluster]:
    """Return the clusters of loud ordinates between two frequencies in Hz.

    `view` is without what left them out of its fit.
    """
    whole = range_of(view, low, high)
    first, stop = whole.first, whole.stop
    u = view.squares[first:stop] / view.spectrum.ordinates[first:stop]
    if len(u) < _AROUND:
        return []
    mean = np.convolve(u, np.ones(_AROUND) / _AROUND, mode="same")
    loud = np.flatnonzero((mean > _LOUD) | (u > _AROUND * _LOUD))
    found: list[Cluster] = []
    for k in loud.tolist():
        if found:
            last = found[-1]
            width = last.stop - last.first
            reach = max(2 * _MARGIN, min(_BRIDGED, (first + k) // 50), width // 2)
            if k < last.stop + reach:
                found[-1] = Cluster(last.first, k + 1)
                continue
        found.append(Cluster(k, k + 1))
    grown = [Cluster(max(0, c.first - _MARGIN), min(len(u), c.stop + _MARGIN)) for c in found]
    kept = [c for c in grown if float(np.sum(u[c.first : c.stop] - 1)) > _LEAST]
    return [Cluster(first + c.first, first + c.stop) for c in kept]


def core(view: View, cluster: Cluster, share: float = _CORE) -> Cluster:
    """Return the shortest part of a cluster that holds so much of its power: a line on a slope."""
    inside = slice(cluster.first, cluster.stop)
    power = view.squares[inside] - view.spectrum.ordinates[inside]
    below = np.concatenate([[0.0], np.cumsum(power)])
    # One that begins with ordinate k ends where so much more lies below; beyond the end, none does.
    begins = np.arange(len(power))
    ends = np.searchsorted(np.maximum.accumulate(below), below[:-1] + share * below[-1])
    sizes = np.where(ends < len(below), np.maximum(ends - begins, 1), len(power))
    first = cluster.first + int(np.argmin(sizes))
    stop = first + int(sizes.min())
    return Cluster(max(cluster.first, first - _MARGIN), min(cluster.stop, stop + _MARGIN))


def lines_of(view: View, cluster: Cluster) -> list[Cluster]:
    """Return the parts of a cluster between which its density falls far below the peaks of both.

    Two motors that run at nearly the same speed are loud all the way from one to the other. Powers
    of noise scatter; the more there are, the more are in a mean, so that in noise of any width less
    than one in 100 has a fifth of another by chance. What goes to and fro is loud where it turns
    too, but there at one time, here at another.
    """
    inside = slice(cluster.first, cluster.stop)
    u = view.squares[inside] / view.spectrum.ordinates[inside]
    if len(u) < 3 * _VALLEY:
        return [cluster]
    from scipy.signal import find_peaks  # half a second to load, and few records have such lines

    size = round(_VALLEY + _VALLEYS * np.log(len(u) / (3 * _VALLEY)))
    mean = np.maximum(np.convolve(u, np.ones(size) / size, mode="same"), 1.0)
    level = np.concatenate([[0.0], np.log(mean), [0.0]])  # a peak at the edge is one
    peaks, _ = find_peaks(level, prominence=np.log(_DEEP), distance=size)
    cuts = [
        cluster.first + left + int(mean[left:right].argmin())
        for left, right in zip((peaks[:-1] - 1).tolist(), peaks[1:].tolist(), strict=True)
    ]
    edges = [cluster.first, *cuts, cluster.stop]
    parts = [Cluster(first, stop) for first, stop in pairwise(edges)]
    return parts if all(_is_all_along(view, part) for part in parts) else [cluster]


def _is_all_along(view: View, cluster: Cluster) -> bool:
    """Return whether there is power in a cluster in all parts of the record."""
    parts = np.array_split(wave_inside(view, cluster), _TIMES)
    power = [float(np.sum(part**2)) for part in parts]
    return float(np.quantile(power, 1 / _PARTS)) > _FADED * float(np.mean(power))


def wave_inside(view: View, cluster: Cluster) -> Array:
    """Return the part of the data within a cluster, in time."""
    kept = np.zeros_like(view.ordinates)
    kept[cluster.first : cluster.stop] = view.ordinates[cluster.first : cluster.stop]
    return in_time(kept)


def profile_of(view: View, cluster: Cluster) -> tuple[LineProfile, float]:
    """Return the power of a cluster above the noise, and the relative error of its square root."""
    grid, n = view.grid, view.grid.n
    unit = grid.rate_hz / (2 * n)
    inside = slice(cluster.first, cluster.stop)
    noise = view.spectrum.ordinates[inside]
    excess = view.squares[inside] - noise
    total = max(float(excess.sum()), 1e-12 * float(noise.sum()))
    width = cluster.stop - cluster.first
    pieces = min(_SHARES, max(1, width // 2))
    # Bands of equal width share an ordinate: whole ones would shift the line by as much as ten.
    below = np.concatenate([[0.0], np.cumsum(excess)])
    power = np.maximum(
        np.diff(np.interp(np.linspace(0, width, pieces + 1), range(width + 1), below)), 0.0
    )
    shares = power / power.sum() if power.sum() > 0 else np.full(pieces, 1 / pieces)
    variance = float(np.sum(4 * noise * np.maximum(excess, 0.0) + 2 * noise**2))
    low, high = (cluster.first + 0.5) * unit, (cluster.stop + 0.5) * unit
    profile = LineProfile(float(np.sqrt(total / n)), low, high, tuple(shares.tolist()))
    return profile, float(np.sqrt(variance)) / (2 * total)


def gain_of(view: View, cluster: Cluster, profile: LineProfile) -> float:
    """Return the log-likelihood that a profile gains on its ordinates over the noise beside it.

    What is searched for as one tone may be several lines: each has what it gains by itself.
    """
    inside = slice(cluster.first, cluster.stop)
    noise, pieces = view.spectrum.ordinates[inside], len(profile.shares)
    width = cluster.stop - cluster.first
    piece = ((np.arange(width) + 0.5) * pieces / width).astype(int)
    density = profile.sigma**2 * view.grid.n * np.array(profile.shares) * pieces / width
    more = density[piece] / noise
    u = view.squares[inside] / noise
    gain = float(np.sum(u * more / (1 + more) - np.log1p(more))) / 2
    return max(gain - pieces / 2, 0.0)  # each share was fitted to what it is judged by


def drifting_line(
    view: View, cluster: Cluster, searched: Candidate, band: Cluster | None = None
) -> Candidate | None:
    """Return the line that a cluster of ordinates is; None for what is no line.

    Parameters
    ----------
    view : View
        Without the tone, its frequencies in the fit's excluded ranges or not.
    cluster : Cluster
        Where its power is.
    searched : Candidate
        What was found there first: the alternatives that were looked at, and what paid for them.
    band : Cluster, optional
        Where something is known, on the slope of which it may stand.
    """
    profile, error = profile_of(view, cluster)
    n, rate = view.grid.n, view.grid.rate_hz
    unit = rate / (2 * n)
    inside = slice(cluster.first, cluster.stop)
    noise = view.spectrum.ordinates[inside]
    weight = np.maximum(view.squares[inside] - noise, 0.0)
    f = view.grid.frequency[inside]
    if not weight.any():
        return None
    total = np.cumsum(weight) / weight.sum()
    centre = float(np.average(f, weights=weight))
    ends = np.interp([(1 - _HOLDS) / 2, (1 + _HOLDS) / 2], total, f)
    width = max(float(ends[1] - ends[0]), 2 * unit)
    if width > _WIDEST * centre:
        return None
    there = presence_of(view, profile.low, profile.high)
    held = _predicted(view, centre, width, there)
    if held is None or held.nats <= held.error or not _stands_out(view, cluster, band):
        return None
    independent = max(1.0, width * view.series.duration_s)
    moving = _history(view, centre, width)
    effect = DriftingLine(
        Estimate.of(centre, width / np.sqrt(12 * independent), "Hz"),
        _bandwidth(f, weight, noise, unit),
        Estimate.of_log(profile.sigma, error, view.unit),
        *moving,
        share_of_time=there.share if there else None,
        present=there.spans if there else None,
    )
    return Candidate(
        effect,
        gain_of(view, cluster, profile),
        searched.log_alternatives,
        alpha=searched.alpha,
        is_paid=searched.is_paid,
        excluded=((profile.low, profile.high),),
        profiles=(profile,),
        held_out=held,
    )


def _bandwidth(f: Array, power: Array, noise: Array, unit: float) -> Estimate:
    """Return the width that holds most of the power of a line.

    It is that of this record, not of a process: each edge is known as far as the record resolves,
    which also makes the line a little wider, and as noise moves the power on its two sides.

    Parameters
    ----------
    f, power, noise : ndarray
        Frequencies in Hz, the power of the line at each, and the variance of the noise there.
    unit : float
        Distance of ordinates in Hz.
    """
    below = np.cumsum(power) / power.sum()
    variance = np.cumsum(4 * noise * power + 2 * noise**2) / power.sum() ** 2
    edges, errors = [], []
    for share in ((1 - _HOLDS) / 2, (1 + _HOLDS) / 2):
        edge = float(np.interp(share, below, f))
        own = float(np.interp(edge, f, variance))
        moved = np.sqrt(own * (1 - share) ** 2 + (variance[-1] - own) * share**2)
        first, last = np.interp([share - moved, share + moved], below, f)
        edges.append(edge)
        errors.append(float(last - first) / 2)
    width = max(edges[1] - edges[0] - _WIDER * unit, 2 * unit)
    return Estimate.of_log(
        width, float(np.linalg.norm([*errors, 2 * _RESOLVED * unit])) / width, "Hz"
    )


def _stands_out(view: View, cluster: Cluster, band: Cluster | None) -> bool:
    """Return whether the power is in the cluster: a sweep is as loud beside any piece of it."""
    width = cluster.stop - cluster.first
    reach, gap = max(_BESIDE * width, 32), max(2, width // 4)
    near = slice(max(0, cluster.first - gap - reach), cluster.stop + gap + reach)
    power = view.squares[near] / view.spectrum.ordinates[near]
    at = near.start + np.arange(len(power))
    beside = (at < cluster.first - gap) | (at >= cluster.stop + gap)
    if band is not None:
        beside &= (at < band.first) | (at >= band.stop)
    if not beside.any():
        return False
    # The median: the next line beside it is no part of it.
    other = float(np.median(power[beside])) / CHI_SQUARE_MEDIAN - 1
    own = float(power[(at >= cluster.first) & (at < cluster.stop)].mean()) - 1
    return bool(other < _CLEARLY * np.sqrt(6 / np.count_nonzero(beside)) or own > _ABOVE * other)


def _around(view: View, centre: float, reach: float) -> Array:
    """Return the part of the data within a distance of a frequency, in time."""
    reach = min(reach, 0.9 * centre)
    near, own = view.grid.around(centre, reach), np.zeros(view.grid.n - 1)
    inside = np.abs(view.grid.frequency[near] - centre) < reach
    own[near] = np.where(inside, view.ordinates[near], 0.0)
    return in_time(own)


def _predicted(view: View, centre: float, width: float, there: Presence | None) -> HeldOut | None:
    """Predict the amplitude in each block from its neighbours; None where that explains nothing."""
    n, rate = view.grid.n, view.grid.rate_hz
    smooth_s = _BLOCK / width
    if there is not None:
        smooth_s = min(smooth_s, there.longest_s / (2 * _PARTS))
    length = int(max(smooth_s, 2 / centre) * rate)
    blocks = n // length
    if blocks < 2 * _PARTS:
        blocks, length = 2 * _PARTS, n // (2 * _PARTS)
    if length < 4:
        return None
    amplitude = demodulate(_around(view, centre, 4 * rate / length), rate, centre, blocks)
    near = np.ones(blocks - 2, bool)
    if there is not None:  # elsewhere a prediction only adds noise
        middles = np.arange(1.5, blocks - 1) * length
        near = there.surroundings(view.time_at(middles.astype(np.float64)))
        if np.count_nonzero(near) < _PARTS:  # a few waves: too few to be told from a knock
            return None
    neighbours = ((amplitude[:-2] + amplitude[2:]) / 2)[near]
    middle = amplitude[1:-1][near]
    shrunk = float(np.real(np.vdot(neighbours, middle)) / np.vdot(neighbours, neighbours).real)
    left = middle - max(shrunk, 0.0) * neighbours
    noise = float(view.spectrum.at(np.array([centre]))[0])
    floor = 4 * noise / length
    seen = (np.abs(middle) ** 2 - np.abs(left) ** 2) / floor
    if seen.sum() <= _SURELY * error_of_sum(seen):
        return None
    predicted = _logliks(left, floor)
    by_noise, by_constant = _logliks(middle, floor), _logliks(middle - middle.mean(), floor)
    gained, than = predicted - by_constant, "noise of the same power and a constant line"
    if by_noise.sum() > by_constant.sum():
        gained = predicted - by_noise
    elif abs(gained.sum()) < error_of_sum(gained):
        # The search has refused a constant line, which does no better here: it is a line all the
        # same, and not noise.
        gained, than = predicted - by_noise, "noise of the same power"
    return HeldOut(
        nats=float(gained.sum()),
        error=error_of_sum(gained),
        design=f"each block of {length / rate:.3g} s by its neighbours, against {than}",
    )


def _logliks(left: NDArray[np.complex128], floor: float) -> Array:
    """Return the log-likelihood of complex residuals under their own variance, but for constants.

    It is never less than that of the noise in which the line lies.
    """
    power = np.abs(left) ** 2
    variance = max(float(power.mean()), floor)
    return np.asarray(-power / variance - np.log(variance))


def _history(view: View, centre: float, width: float) -> tuple[float, float, float, float]:
    """Return the frequency in the first and in the last part, and the least and most amplitude."""
    rate = view.grid.rate_hz
    reach = max(2 * width, 4 * _PARTS * rate / view.grid.n)
    noise = float(view.spectrum.at(np.array([centre]))[0]) * 4 * reach / rate
    frequencies, amplitudes = [], []
    for part in np.array_split(_around(view, centre, reach), _PARTS):
        power = np.abs(np.fft.rfft(part * np.hanning(len(part)))) ** 2
        f = np.arange(len(power)) * rate / len(part)
        inside = np.abs(f - centre) < reach
        weight = np.maximum(power[inside] - np.median(power[inside]), 0.0)
        frequencies.append(float(np.average(f[inside], weights=weight)) if weight.any() else centre)
        amplitudes.append(float(np.sqrt(max(float(np.var(part)) - noise, 0.0))))
    return frequencies[0], frequencies[-1], min(amplitudes), max(amplitudes)
