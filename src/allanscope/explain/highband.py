"""What the streaming spectrum shows above the rows of a long run.

A run that no longer fits in memory is kept as block means, and what lies above their Nyquist
frequency only as a density in log-spaced bands. A low-pass and a tone still show there: the bands
are fitted by white noise behind a filter, and runs of bands far above it are reported. Within one
band a line and a narrow resonance look alike, so each names the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import errors_at
from allanscope.explain.effects.band_limit import BandLimit
from allanscope.explain.effects.narrowband import Narrowband
from allanscope.explain.effects.sinusoid import Sinusoid
from allanscope.explain.view import View
from allanscope.noise.filters import Butterworth, OnePole
from allanscope.optimise import minimise
from allanscope.quantities import TWO_SIDED_95
from allanscope.spectrum import Density

__all__ = ["above_the_rows"]

_SEEN_IN = "streaming spectrum"

Array = NDArray[np.float64]

_LEAST_BANDS = 8
"""Bands above the rows from which their level and a filter can be told."""
_LINE_Z = 6.0
"""Sigma from which a band holds a line: a few hundred of a clean record do not reach it."""
_NEXT_Z = 4.0
"""Sigma from which a band beside it belongs to it."""
_TURNS = 3
"""Most fits of the filter, each without the bands that stand out above the one before."""
_MOST_AVERAGES = 1e5
"""A band's weight is that of so many averages at most: no filter is the model to a part in 300."""
_NARROW = 3
"""Most neighbouring bands that a line spreads over."""


@dataclass(frozen=True)
class _Bands:
    f: Array
    width: Array
    power: Array
    averages: Array
    floor: float
    rate: float


@dataclass(frozen=True)
class _Filter:
    """White noise behind a low-pass of one pole or two.

    Attributes
    ----------
    point : ndarray, shape (2,)
        Logarithms of the level and of the cutoff in Hz.
    poles : int
        1 or 2.
    """

    point: Array
    poles: int

    @property
    def cutoff(self) -> float:
        return float(np.exp(np.clip(self.point[1], -12, 20)))

    def at(self, bands: _Bands) -> Array:
        """Return the power in the bands, the rounding included."""
        f, rate = bands.f, bands.rate
        if self.poles == 1:
            passed = OnePole(self.cutoff).response(f, 1 / rate)
        else:
            passed = Butterworth(self.cutoff, 2.0).response(f, 1 / rate)
        return np.asarray(np.exp(self.point[0]) * passed + bands.floor)


def above_the_rows(view: View, density: Density) -> View:
    """Add what the density shows above the Nyquist frequency of the rows of a view.

    Averaging attenuates such a tone but does not remove it: the rows show it at its alias. Where
    both are seen they are one, the band tells which, and the rows tell its frequency and size.
    """
    rate = view.series.rate_hz * view.series.stride
    seen = (density.frequency > view.series.rate_hz / 2) & (density.density > 0)
    seen &= density.frequency < rate / 2
    if np.count_nonzero(seen) < _LEAST_BANDS:
        return view
    bands = _Bands(
        density.frequency[seen],
        density.width[seen],
        density.density[seen],
        density.averages[seen],
        2 * view.step**2 / 12 / rate,
        rate,
    )
    model, limit = _baseline(view, bands)
    z = (bands.power / model - 1) * np.sqrt(bands.averages)
    accepted = list(view.accepted) + ([] if limit is None else [limit])
    for low, high in _runs(z):
        tone = _tone(view, bands, bands.power - model, z, slice(low, high + 1))
        twins = [c for c in accepted if _unfolded(view, c, tone) is not None]
        if twins:
            accepted = [_unfolded(view, c, tone) or c for c in accepted]
        else:
            accepted.append(tone)
    return replace(view, accepted=tuple(accepted))


def _unfolded(view: View, seen: Candidate, tone: Candidate) -> Candidate | None:
    """Return a line of the rows at the frequency of which it is the alias, if the tone has it."""
    line, near = seen.effect, tone.effect
    if not isinstance(line, Sinusoid) or not isinstance(near, Sinusoid):
        return None
    at, size, band = line.frequency, line.amplitude, near.frequency
    row_hz, stride = view.series.rate_hz, view.series.stride
    for fold in range(1, stride // 2 + 1):
        for sign in (-1, 1):
            f = fold * row_hz + sign * at.value
            if abs(f - band.value) > TWO_SIDED_95 * band.error:
                continue
            x = np.pi * f / (row_hz * stride)
            passed = float(abs(np.sin(stride * x) / (stride * np.sin(x))))
            found = replace(
                line,
                frequency=Estimate.of(f, at.error, "Hz"),
                amplitude=Estimate.of(size.value / passed, size.error / passed, size.unit),
            )
            cut = tone.excluded
            return replace(
                seen, effect=found, excluded=cut, seen_in=f"rows at its alias {at.value:.4g} Hz"
            )
    return None


def _baseline(view: View, bands: _Bands) -> tuple[Array, Candidate | None]:
    """Fit white noise, flat or filtered, to the bands that no tone lifts."""
    power = bands.power
    weight = np.minimum(bands.averages, _MOST_AVERAGES)
    quiet = np.ones(len(power), bool)
    for _ in range(_TURNS):
        use = weight * quiet
        found = _filter(bands, use)
        filtered = found.at(bands)
        flat = np.full_like(power, float(np.sum(use * power) / np.sum(use)))
        before = quiet
        quiet = (power / filtered - 1) * np.sqrt(bands.averages) < _NEXT_Z
        if np.array_equal(quiet, before):
            break  # the next fit would be of the same bands
    use = weight * quiet
    gain = _deviance(use, power, flat) - _deviance(use, power, filtered)
    cutoff = Estimate.of_log(found.cutoff, _error_of_cutoff(bands, use, found), "Hz")
    limit = Candidate(BandLimit(cutoff), gain, float(np.log(30)), seen_in=_SEEN_IN)
    if limit.excess < 0:
        return flat, None
    return filtered, None if view.has(BandLimit.kind) else limit


def _filter(bands: _Bands, use: Array) -> _Filter:
    """Fit white noise behind one pole and behind two, and take the likelier."""
    level = float(np.median(bands.power))
    fits = []
    for poles in (1, 2):

        def loss(point: Array, poles: int = poles) -> float:
            return _deviance(use, bands.power, _Filter(point, poles).at(bands))

        for share in (0.1, 0.3, 1.0):
            start = np.log([level, share * bands.rate])
            found = minimise(loss, start, turns=800)
            fits.append((found.value, _Filter(found.x, poles)))
    return min(fits, key=lambda fit: fit[0])[1]


def _error_of_cutoff(bands: _Bands, use: Array, found: _Filter) -> float:
    """Return the standard error of the logarithm of the cutoff, the level not being known.

    Far above the cutoff the level may be exchanged for it.
    """

    def loss(point: Array) -> float:
        return _deviance(use, bands.power, replace(found, point=point).at(bands))

    return float(np.nan_to_num(errors_at(loss, found.point, np.full(2, 0.01))[1], nan=10.0))


def _deviance(weight: Array, power: Array, model: Array) -> float:
    return float(np.sum(weight * (np.log(model) + power / model)))


def _runs(z: Array) -> list[tuple[int, int]]:
    """First and last band of every run that holds a band above the limit."""
    runs: list[tuple[int, int]] = []
    for k in np.flatnonzero(z > _LINE_Z):
        if runs and k <= runs[-1][1]:
            continue
        low = high = int(k)
        while low > 0 and z[low - 1] > _NEXT_Z:
            low -= 1
        while high < len(z) - 1 and z[high + 1] > _NEXT_Z:
            high += 1
        runs.append((low, high))
    return runs


def _tone(view: View, bands: _Bands, excess: Array, z: Array, inside: slice) -> Candidate:
    f, width, averages = bands.f, bands.width, bands.averages
    power = float(np.sum(excess[inside] * width[inside]))
    error = float(np.sqrt(np.sum((np.abs(excess[inside]) * width[inside]) ** 2 / averages[inside])))
    centre = float(np.average(f[inside], weights=np.maximum(excess[inside], 0) * width[inside]))
    half = float(np.sum(width[inside])) / 2
    where = Estimate(centre, centre - half, centre + half, "Hz")
    gain, looked_at = float(np.max(z[inside]) ** 2 / 2), float(np.log(len(z)))
    cut = ((centre - half, centre + half),)
    if inside.stop - inside.start <= _NARROW:
        amplitude = np.sqrt(2 * power)
        line = Sinusoid(where, Estimate.of(amplitude, error / amplitude, view.unit))
        rivals = {Narrowband.kind: gain}
        return Candidate(line, gain, looked_at, rivals=rivals, seen_in=_SEEN_IN, excluded=cut)
    sigma = Estimate.of(np.sqrt(power), error / (2 * np.sqrt(power)), view.unit)
    band = Narrowband(where, Estimate(half, half / 2, 2 * half, "Hz"), sigma)
    return Candidate(band, gain, looked_at, seen_in=_SEEN_IN, excluded=cut)
