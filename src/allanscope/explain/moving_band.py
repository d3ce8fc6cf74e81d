r"""Noise in a band that is no resonance's: its centre or its level changes through the record.

`narrowband` refuses it, for the mean spectrum of what drifts has no form of its own. What tells it
from what has no name:

* the spectrum of each part of the record is predicted by that of its neighbours,
  :math:`\hat S_p(f) = \tfrac12 (S_{p-1}(f) + S_{p+1}(f))`, or by the mean of all others;
* it is there in every quarter of the record, though it may come and go;
* its power is spread as that of noise: that of a modulated tone is in few ordinates;
* it is in much the same range in both halves: a sweep goes through its range once, or to and fro.

It is in the model as lines that wander around the centres of the parts (`MovingLine`): what it
brings far beside the band belongs to it, not to a process that the search would find there. Where
that misses the spectrum, it is a component with the measured distribution of its power
(`LineProfile`).

A short record has no parts in which to see that, and a band of few coherence times has no spectrum
in them. What no line explains there is noise in a band as well, if it has the form and the envelope
of noise, lasts, and one half of the record tells the other's (`noise_between`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate, HeldOut, error_of_sum
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import errors_at
from allanscope.explain.effects.drifting_line import Cluster, gain_of, profile_of, wave_inside
from allanscope.explain.effects.narrowband import Narrowband, band_between, misfit
from allanscope.explain.series import block_means
from allanscope.explain.stationarity import UNSTEADY, bartlett_z_of
from allanscope.explain.view import View
from allanscope.noise.components import LineProfile, MovingLine
from allanscope.optimise import minimise
from allanscope.quantities import TWO_SIDED_95

__all__ = ["moving_band", "noise_between"]

Array = NDArray[np.float64]

_PARTS = (32, 16, 8)
"""Parts of time, as many as leave each enough ordinates."""
_FEWEST = 24
"""Ordinates of a part within the range."""
_SMOOTHED = 12
"""Share of these over which the spectrum of a part is smoothed."""
_HANN = 1.944
"""Ordinates of a Hann window that know as much as one."""
_QUARTERS = (0.25, 0.5, 0.75)
"""Shares of the power below the lower edge, the centre and the upper edge of a resonance, its edges
where its density is half."""
_WIDEST = 0.5
"""Width over frequency beyond which no one would call the band narrow."""
_QUARTERS_OF_TIME, _LEAST_LEVEL = 4, 0.3
"""Parts of the record, and rms in the faintest over that in the loudest."""
_CONCENTRATED = 2.0
"""Mean square of the powers of ordinates over that of noise."""
_USUAL = (0.05, 0.95)
"""Quantiles of the centre over the parts between which it is said to move."""
_SURELY = 3.0
"""Standard errors of the variance of the power over the parts beyond which its level changes."""
_FACTOR = 1.5
"""Logarithm of the largest factor, and of the least, of what the centres move by."""
_STEP = 0.05
"""Of the logarithms of bandwidth and factor, in which the likelihood is a parabola."""
_MISSHAPEN, _BESIDE = 4.0, 3.0
"""Sigma of what lines that wander may leave of the spectrum of the band, and so far beside it."""
_ALIKE = 0.3
"""Cosine between the spectra of halves of a record: a sweep has 0."""
_FEWEST_AT_ALL, _TOO_UNSTEADY = 3.0, 6.0
"""Coherence times of which fewer are a line that changes once, whatever else it is not; sigma by
which the power of noise whose level changes is less even than that of noise, at the most."""
_IN_A_PART, _LEVELS = 4.0, (4, 16)
"""Coherence times in a part of the record, and how many parts, over which its rms is told."""


def moving_band(view: View, cluster: Cluster, searched: Candidate) -> Candidate | None:
    """Return the band of noise that a range of ordinates is, or None.

    Parameters
    ----------
    view : View
        Without the band, its frequencies in the fit's excluded ranges or not.
    cluster : Cluster
        Where its power is.
    searched : Candidate
        What was found there first: the alternatives that were looked at, and what paid for them.
    """
    profile, error = profile_of(view, cluster)
    parts = _spectra(view, profile.low, profile.high)
    if parts is None or 2 * TWO_SIDED_95 * error > 1:
        return None
    f, ratio = parts
    held, is_moving = _predicted(ratio)
    is_steady = _is_lasting(ratio) and _alikeness(ratio) >= _ALIKE
    if held.nats <= held.error or not is_steady or _in_few(view, cluster):
        return None
    excess = np.maximum(_smoothed(ratio) - 1, 0.0)
    power = excess.mean(axis=0) * view.spectrum.at(f)
    low, centre, high = np.interp(_QUARTERS, np.cumsum(power) / power.sum(), f).tolist()
    width = high - low
    centres = excess @ f / np.maximum(excess.sum(axis=1), 1e-12)
    bare = view.without(searched)
    lines = _lines(bare, centres, width)
    widest = width if lines is None else max(width, lines[0].bandwidth)
    if widest > _WIDEST * centre:
        return None
    least, most = np.quantile(centres, _USUAL)
    independent = max(1.0, width * view.series.duration_s)
    effect = Narrowband(
        Estimate.of(centre, width / np.sqrt(12 * independent), "Hz"),
        Estimate.of_log(width, 1 / np.sqrt(independent), "Hz"),
        Estimate.of_log(profile.sigma, error, view.unit),
        moves=(float(least), float(most)) if is_moving else None,
        swells=_swelling(excess, profile.sigma, independent),
    )
    found = replace(searched, gain=gain_of(view, cluster, profile), held_out=held)
    measured = _as_measured(found, profile)
    if lines is None:
        return replace(measured, effect=effect)
    part, log_error = lines
    effect = replace(effect, bandwidth=Estimate.of_log(part.bandwidth, log_error, "Hz"))
    after = bare.with_parts(part)
    left, count = misfit(after, centre, _BESIDE * (centre - profile.low))
    if left > _MISSHAPEN * np.sqrt(count / 2):
        return replace(measured, effect=effect)
    model = after.spectrum.model
    size = model.amplitude_behind(model.components[-1], centre)
    effect = replace(effect, sigma=Estimate.of_log(size, error, view.unit))
    return replace(found, effect=effect, parts=(part,), excluded=())


def noise_between(view: View, cluster: Cluster, searched: Candidate) -> Candidate | None:
    """Return the band of noise that a range of ordinates is though its parts cannot show it.

    See `moving_band` for the parameters.
    """
    bare = view.without(searched)
    fit = band_between(bare, cluster.first, cluster.stop)
    if fit is None:
        return None
    band, found = fit
    if not (band.lasts(bare, _FEWEST_AT_ALL) and band.is_noise(bare, found)):
        return None
    unsteady = bartlett_z_of(bare, found)
    if unsteady > _TOO_UNSTEADY:
        return None
    held = band.hold_out(bare, found)
    if held is None or held.nats <= held.error:
        return None
    named = replace(searched, effect=band, gain=found.gain, held_out=held)
    if unsteady < UNSTEADY:
        return replace(named, parts=found.parts, excluded=())
    swelling = replace(band, swells=_least_and_most(bare, cluster, band))
    return _as_measured(replace(named, effect=swelling), profile_of(view, cluster)[0])


def _as_measured(band: Candidate, profile: LineProfile) -> Candidate:
    """Return a band left out of the fit, with the measured distribution of its power instead."""
    return replace(band, excluded=((profile.low, profile.high),), profiles=(profile,))


def _least_and_most(bare: View, cluster: Cluster, band: Narrowband) -> tuple[float, float]:
    """Return the rms of a range over parts of the record of some coherence times each."""
    times = band.bandwidth.value * bare.series.duration_s
    parts = int(np.clip(times / _IN_A_PART, *_LEVELS))
    power = block_means(wave_inside(bare, cluster) ** 2, parts)
    noise = float(bare.spectrum.ordinates[cluster.first : cluster.stop].sum()) / bare.grid.n
    least, most = np.sqrt(np.maximum([power.min() - noise, power.max() - noise], 0.0)).tolist()
    return least, most


def _lines(bare: View, centres: Array, width: float) -> tuple[MovingLine, float] | None:
    """Return the likeliest line whose centre moves as that of the band, with the error of ln width.

    Chance makes measured centres move farther than the true ones: what they move by has a factor,
    which is fitted together with the bandwidth.
    """
    mean = float(centres.mean())

    def line(point: Array) -> MovingLine:
        bandwidth, factor = np.exp(point).tolist()
        return MovingLine(1.0, mean, bandwidth, tuple((factor * (centres - mean)).tolist()))

    def loss(point: Array) -> float:
        if point[0] > np.log(mean) or abs(point[1]) > _FACTOR:
            return float("inf")
        return -bare.loglik_with(line(point))

    first = np.log([width / 2, 0.8])
    found = minimise(loss, first, 0.3 * np.eye(2), x_within=1e-3, within=1e-2, turns=80)
    if not found.converged or abs(found.x[1]) > _FACTOR - _STEP:
        return None
    error = float(errors_at(loss, found.x, np.full(2, _STEP))[0])
    return (line(found.x), error) if error > 0 else None


def _spectra(view: View, low: float, high: float) -> tuple[Array, Array] | None:
    """Return frequencies (m,) in a range and, of each part of time, the power there over the noise.

    The second has shape (parts, m). None where the record is too short to see anything move.
    """
    rate, n = view.grid.rate_hz, len(view.data)
    for parts in _PARTS:
        size = n // parts
        f = np.arange(size // 2 + 1) * rate / size
        inside = (f >= low) & (f <= high)
        if np.count_nonzero(inside) >= _FEWEST:
            window = np.hanning(size)
            rows = (view.data[: size * parts] - view.data.mean()).reshape(parts, size) * window
            power = np.abs(np.fft.rfft(rows, axis=1)[:, inside]) ** 2 / np.sum(window**2)
            return f[inside], power / view.spectrum.at(f[inside])
    return None


def _smoothed(ratio: Array) -> Array:
    """Return spectra averaged over a twelfth of the range, as far as it reaches."""
    size = max(3, ratio.shape[1] // _SMOOTHED)
    weight = np.convolve(np.ones(ratio.shape[1]), np.ones(size), mode="same")
    return np.array([np.convolve(row, np.ones(size), mode="same") / weight for row in ratio])


def _predicted(ratio: Array) -> tuple[HeldOut, bool]:
    """Predict the spectrum of each part from others, and tell whether its neighbours know best."""
    smooth = _smoothed(ratio)
    inner = slice(1, -1)
    near = (smooth[:-2] + smooth[2:]) / 2
    others = (smooth.sum(axis=0) - smooth[inner]) / (len(smooth) - 1)

    def logliks(expected: Array) -> Array:
        v = np.maximum(expected, 1.0)
        return np.asarray(-(np.log(v) + ratio[inner] / v).sum(axis=1) / _HANN)

    by_neighbours, by_others, nothing = map(logliks, (near, others, np.ones_like(near)))
    better = by_neighbours - by_others
    is_moving = bool(better.sum() > error_of_sum(better))
    gain = (by_neighbours if is_moving else by_others) - nothing
    held = HeldOut(
        nats=float(gain.sum()),
        error=error_of_sum(gain),
        design=f"the spectrum of each of {len(gain)} parts by "
        f"{'its neighbours' if is_moving else 'the mean of all others'}, against no band",
    )
    return held, is_moving


def _is_lasting(ratio: Array) -> bool:
    quarters = np.array_split((ratio - 1).sum(axis=1), _QUARTERS_OF_TIME)
    level = np.sqrt([max(0.0, float(one.mean())) for one in quarters])
    return bool(level.min() > _LEAST_LEVEL * level.max())


def _swelling(excess: Array, sigma: float, independent: float) -> tuple[float, float] | None:
    """Return the rms between which a band is in 90 % of the parts; None for what chance makes."""
    power = excess.sum(axis=1) / excess.sum(axis=1).mean()
    expected = len(power) / independent
    if float(np.var(power)) < expected * (1 + _SURELY * np.sqrt(2 / len(power))):
        return None
    least, most = sigma * np.sqrt(np.quantile(power, _USUAL))
    return float(least), float(most)


def _in_few(view: View, cluster: Cluster) -> bool:
    """Return whether so much of the power is in few ordinates that it is no noise.

    Squares of noise have a mean square of three times that of their mean, which is smooth.
    """
    inside = slice(cluster.first, cluster.stop)
    u = view.squares[inside] / view.spectrum.ordinates[inside]
    mean = _smoothed(u[None])[0]
    return bool(np.mean(u**2) > _CONCENTRATED * 3 * np.mean(mean**2))


def _alikeness(ratio: Array) -> float:
    """Return the least cosine between mean spectra of halves of the parts.

    Between the first and the second, and the outer and the inner: what goes to and fro is in its
    range twice.
    """
    first, second, third, last = (
        quarter.mean(axis=0) for quarter in np.array_split(_smoothed(ratio) - 1, _QUARTERS_OF_TIME)
    )
    pairs = (first + second, third + last), (first + last, second + third)
    return min(float(a @ b / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-12)) for a, b in pairs)
