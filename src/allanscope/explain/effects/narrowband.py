r"""Noise in a band: a resonance that is shaken by noise, or a line that wanders.

The correlation is that of a damped oscillation,

.. math:: \gamma(t) = \sigma^2 e^{-\pi w |t|} \left(\cos \omega_d t +
          \frac{\pi w}{\omega_d} \sin \omega_d |t|\right)

(or without the sine: a line whose amplitude and phase wander; or a flat top, for noise behind a
band-pass; the likeliest of them) with the full width at half maximum w. Two resonances within each
other's width look like one of another form, and are fitted together (`halved`). Spotted as a run of
ordinates above the model that is wider than a line; f_0, w and sigma are found by Whittle
likelihood on the ordinates around it. It enters the model as a term of the spectrum. Few coherence
times cannot show that it is noise: then it is only what no line explains (`moving_band`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

from allanscope.explain.candidate import ALPHA, Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind, errors_at
from allanscope.explain.effects.unexplained import band_left_over, beside, tone_left_over
from allanscope.explain.presence import presence_of
from allanscope.explain.residual import removes
from allanscope.explain.series import block_means
from allanscope.explain.stationarity import (
    UNSTEADY,
    PowerInParts,
    bartlett_z,
    bartlett_z_of,
    envelope_z,
    reach_of,
    sweeps,
)
from allanscope.explain.view import View
from allanscope.lazy import once
from allanscope.noise.components import Component
from allanscope.noise.components.correlated import Correlated
from allanscope.noise.components.narrowband import FORMS
from allanscope.noise.grid import Grid
from allanscope.noise.selection import calibrated_penalty
from allanscope.optimise import descend, minimise
from allanscope.quantities import measured, periods

Array = NDArray[np.float64]
Shape = Callable[[float, float], Component]
Beside = Callable[[Array], Array]
"""Variance of the ordinates without the band, at frequencies in Hz."""

_WIDEST = 0.5
"""Widest run of ordinates looked at, as a share of its frequency."""
_SUB_BINS = 400
"""Bins in a window: the sums of ordinates between them lose nothing of a band that is resolved."""
_PARTS = 256
"""Of a record, whose powers tell how uneven its noise is."""
_FINEST_HZ = 1e-8
"""Narrowest band: below it is a constant line."""
_NARROWEST, _COLLAPSED = 1.5, 0.5
"""Ordinates below which a band is as wide as a line, and below which a fit will not return."""
_ROUNDS = 3
"""Times that window and band are found from each other."""
_HOPELESS = 0.65
"""Share of the penalty below which the first fit stands: another shape and another background would
have to add 6 nats to so faint a band. Of a hundred at half the penalty and more none gained 4."""
_ROUGHLY = 0.1
"""Nats, and in log width, to which a band is followed at first, and further only if it has hope."""
_PENALTY = calibrated_penalty("narrowband")
"""Nats beyond half of those of as many independent frequencies as there are rows."""
_RESOLVED = 0.05
"""Width over frequency below which bins are as wide as the band."""
_ONE_SHAPE = 0.01
"""Width over frequency below which resonance and wandering line differ by 0.1 nats in 100."""
_NOTHING = 1e-12
"""Share of the largest power that is none."""
_FORBIDDEN, _LOUDEST = 1e15, 100.0
"""Loss beyond the ends of the window, and logarithm of the background over that of the model, of a
variance or a width beyond which there is no likelihood either."""
_SHAPELY, _BROAD = 100.0, 500.0
"""Nats and independent powers from which the form of a band can be told, and that it holds noise:
any tone that moves has a flat top too."""
BROADEST = 0.7
"""Beyond, as a share of the frequency, no one would call the band narrow."""
_FEWEST_COHERENCES = 12.0
"""Fewer coherence times in a record cannot show that a band holds noise."""
_UNSTEADY = 6.0
"""Sigma; noise in bands of any width stayed below 2 in some hundred records."""
_TOO_EVEN, _MISSHAPEN, _MISSED = 5.0, 6.0, 0.02
"""Sigma of the envelope; sigma and share of the gain of what a band leaves: beyond all three it is
a tone whose frequency moves."""
_SUB_BANDS = 64
"""Parts of the surroundings of a band in which its form is compared."""
_SPLITTABLE = 60.0
"""Independent powers from which the form of a band can show that it is two."""
_APART = (0.3, 0.8)
"""Distances from the centre, in bandwidths, from which two are looked for."""
_NARROW, _FAINT, _FARTHEST = 0.125, 0.1, 8.0
"""Width over frequency up to which it is left out of the fit though the model misses more: as far
as it is so large a part of the noise beside it, and so many widths at most."""
_WITHIN = 3.0
"""Distance in bandwidths up to which a frequency belongs to a band."""


_resonance, _wandering, *_flat = FORMS


@dataclass(frozen=True)
class Narrowband(EffectKind):
    """Noise in a band.

    Attributes
    ----------
    overlaps : float or None
        Frequency in Hz of the band within whose width it lies, where the two were fitted together.
    moves : (float, float) or None
        Between which its centre is in 90 % of the record, in Hz, where it moves (`moving_band`).
    swells : (float, float) or None
        Between which its rms is in 90 % of the record, where its level changes.
    """

    frequency: Estimate
    bandwidth: Estimate
    sigma: Estimate
    overlaps: float | None = None
    moves: tuple[float, float] | None = None
    swells: tuple[float, float] | None = None

    kind = "narrowband"
    meaning = "noise in a band: a resonance, or a line that wanders"
    phrase = "narrow-band noise around {frequency}, {sigma} rms"
    as_cause = "narrow-band noise around {frequency} Hz"
    is_line = True
    sized_by = "sigma"
    located_by = "frequency"
    shared_by = "frequency"
    is_process = True
    resembles_bend = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "sinusoid": "a line stays one bin wide",
        "gauss_markov": "its excess goes down to zero frequency",
        "unexplained": "a chirp goes through its band once, in one direction",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        f = self.frequency.value
        words = f"noise in a band of {self.bandwidth.value:.3g} Hz around {f:.4g} Hz{periods(f)}"
        if self.moves is not None:
            words += f", whose centre moves between {self.moves[0]:.4g} and {self.moves[1]:.4g} Hz"
        if self.swells is not None:
            least, most = (measured(one, unit=self.sigma.unit) for one in self.swells)
            words += f", whose rms is {least} to {most}"
        return words

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether another band is the same hypothesis."""
        del grid
        apart = abs(self.frequency.value - other.frequency.value)
        return apart < min(self.bandwidth.value, other.bandwidth.value) / 2

    def holds(self, other: EffectKind) -> bool:
        """Return whether a wave within the band may be all that there is to it."""
        reach = _WITHIN * self.bandwidth.value
        return any(abs(f - self.frequency.value) < reach for f in other.wave_hz)

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Take the most improbable run of ordinates of every width."""
        fits: list[Fitted] = []
        for start, width in _runs(view):
            if any(_is_around(view, start, width, known) for known in fits):
                continue
            if (fit := _fit(view, start, width)) is not None:
                fits.append(fit)
        # What is beside a range that was cut out belongs to it.
        found = [fit for fit in fits if _kept(view, fit[0].frequency.value)]
        if not found:
            return []
        _, best = max(found, key=_gain)
        return [replace(best, gain=best.gain / ordinate_correlation(view.data))]

    def refine(self, view: View) -> Candidate | None:
        """Estimate the band again; one of two that overlap only with the other: it stays."""
        others = (c.effect for c in view.accepted if isinstance(c.effect, Narrowband))
        if self.overlaps is not None and any(o.overlaps is not None for o in others):
            return None
        f0, width = self.frequency.value, self.bandwidth.value
        k = 2 * view.grid.n / view.grid.rate_hz
        again = _fit(view, int(max(0, (f0 - width / 2) * k)), max(2, int(width * k)))
        return None if again is None else again[1]

    def adequate(self, view: View, candidate: Candidate) -> Candidate | None:
        """Return it where it holds noise all along; what holds a tone has no name."""
        f0, width = self.frequency.value, self.bandwidth.value
        if not beside(view, f0) and self._is_steady(view, candidate):
            return candidate
        return tone_left_over(view, candidate, f0, width) or self._left_out(view, candidate)

    def _left_out(self, view: View, candidate: Candidate) -> Candidate | None:
        """Return the range in which it counts, where the model misses too much beside it.

        Only where it is narrow: a broad one may be all that describes the rest.
        """
        f0, width = self.frequency.value, self.bandwidth.value
        if width > _NARROW * f0:
            return None
        low, high = reach_of(view, candidate, _FAINT)  # to a bin, which may be wider
        low = min(max(low, f0 - _FARTHEST * width), f0 - width)
        high = max(min(high, f0 + _FARTHEST * width), f0 + width)
        return band_left_over(view, candidate, (low, high))

    def may_hold(self, view: View, candidate: Candidate) -> bool:
        """Return whether others beside it could make it hold if it lasts: they change its form."""
        is_steady = bartlett_z_of(view, candidate) < UNSTEADY
        return is_steady or self._is_misshapen(view, candidate)

    def lasts(self, view: View, fewest: float = _FEWEST_COHERENCES) -> bool:
        """Return whether the samples may hold noise all along there, whatever the model is."""
        f0, width = self.frequency.value, self.bandwidth.value
        if width * view.series.duration_s < fewest:
            return False
        record = PowerInParts.of_view(view)
        return bartlett_z(record, f0, width) < _UNSTEADY and not sweeps(record, f0, width)

    def _is_steady(self, view: View, candidate: Candidate) -> bool:
        return (
            self.lasts(view)
            and bartlett_z_of(view, candidate) < UNSTEADY
            and self.is_noise(view, candidate)
        )

    def is_noise(self, view: View, candidate: Candidate) -> bool:
        """Return whether it has the envelope and the form of noise, in most of the record."""
        rate, f0, width = view.grid.rate_hz, self.frequency.value, self.bandwidth.value
        return (
            not (
                envelope_z(view.data, rate, f0, width) > _TOO_EVEN
                and self._is_misshapen(view, candidate)
            )
            and removes(view, candidate)
            and presence_of(view, f0 - width, f0 + width) is None
        )

    def _is_misshapen(self, view: View, candidate: Candidate) -> bool:
        """Return whether the spectrum within the band differs from the shape that was fitted."""
        after = view.with_parts(*candidate.parts)
        left, parts = misfit(after, self.frequency.value, _WITHIN * self.bandwidth.value)
        return bool(left > max(_MISSHAPEN * np.sqrt(parts / 2), _MISSED * candidate.gain))


def band_between(view: View, first: int, stop: int) -> tuple[Narrowband, Candidate] | None:
    """Return the likeliest band of a range of ordinates; None where none passes its penalty there.

    Parameters
    ----------
    view : View
        Without what left them out of its fit.
    first, stop : int
        The ordinates.
    """
    fit = _fit(view, first, stop - first)
    if fit is None or fit[1].excess <= 0:
        return None
    low, high = np.array([first + 1, stop]) * view.grid.rate_hz / (2 * view.grid.n)
    return fit if low <= fit[0].frequency.value <= high else None


def misfit(view: View, centre: float, reach: float) -> tuple[float, int]:
    """Return the nats that the spectrum around a frequency differs by from the model.

    Parameters
    ----------
    view : View
        With the band.
    centre, reach : float
        What is looked at, in Hz.

    Returns
    -------
    float, int
        Nats, and in how many parts.
    """
    around = view.grid.around(centre, reach)
    near = np.flatnonzero(np.abs(view.grid.frequency[around] - centre) < reach)
    parts = np.array_split(near, min(_SUB_BANDS, max(1, len(near) // 8)))
    u = view.squares[around] / view.spectrum.ordinates[around]
    ratio = np.array([u[part].mean() for part in parts])
    count = np.array([len(part) for part in parts])
    return float(np.sum(count * (ratio - 1 - np.log(ratio)) - 1)) / 2, len(parts)


Fitted = tuple[Narrowband, Candidate]


def _kept(view: View, frequency: float) -> bool:
    at = int(frequency * 2 * view.grid.n / view.grid.rate_hz) - 1
    return bool(view.spectrum.kept[min(max(at, 0), view.grid.n - 2)])


def _is_around(view: View, start: int, width: int, fit: Fitted) -> bool:
    """Return whether a run is around the centre of a band, and would only lead to it again.

    What is loud may be described better from another beginning.
    """
    at = fit[0].frequency.value * 2 * view.grid.n / view.grid.rate_hz
    return start <= at <= start + width and fit[1].gain < _SHAPELY


def _runs(view: View) -> list[tuple[int, int]]:
    """First ordinate and width of the most improbable runs, best first."""
    u = view.squares / view.spectrum.ordinates
    u[~view.spectrum.kept] = 1.0
    capped = np.minimum(u, 25.0)
    total = np.concatenate([[0.0], np.cumsum(capped)])
    runs = []
    width = 4
    while width < len(u) // 3:
        hop = max(1, width // 4)
        first = np.arange(max(1, int(width / _WIDEST / 1.5)), len(u) - width, hop)
        if len(first) == 0:
            break
        sums = total[first + width] - total[first]
        k = int(np.argmax(sums))
        tail = gammaincc(width / 2, sums[k] / 2)
        bits = -np.log(max(float(tail), 1e-300))
        if bits > np.log(len(u)):
            excess = float(sums[k] - width)
            beyond = excess**2 / (4 * width) if tail < 1e-290 else 0.0
            runs.append((max(bits, beyond), int(first[k]), width))
        width *= 2
    runs.sort(reverse=True)
    return [(start, width) for _, start, width in runs[:2]]


@dataclass(frozen=True)
class _Window:
    """The ordinates around a band, averaged into at most some hundred bins."""

    frequency: Array
    power: Array
    background: Array
    size: int
    grid: Grid
    shape: Shape

    def loss(self, p: Array) -> float:
        """Negative log-likelihood of (log background factor, log variance, f0, log width).

        Of several bands: the last three again for each.
        """
        grid, bands = self.grid, p[1:].reshape(-1, 3).tolist()
        if p[0] > _LOUDEST:
            return _FORBIDDEN
        variance = self.background * np.exp(p[0])
        for last, (log_variance, f0, log_width) in enumerate(bands, 1 - len(bands)):
            if max(log_variance, log_width) > _LOUDEST:
                return _FORBIDDEN
            width, size = float(np.exp(log_width)), float(np.exp(log_variance))
            inside = self.frequency[0] < f0 < self.frequency[-1]
            if not inside or not _FINEST_HZ < width < 1.5 * f0:
                return _FORBIDDEN
            band = self.shape(f0, width)
            if last == 0 and isinstance(band, Correlated):
                covariance = band.covariance(grid.dt).averaged(grid.stride)
                misfit = covariance.misfit(size, self.square, self.power, variance)
                return 0.5 * self.size * misfit
            variance = variance + size * band.spectrum(self.frequency, grid.dt, grid.stride)
        return float(0.5 * self.size * np.sum(np.log(variance) + self.power / variance))

    @once
    def square(self) -> Array:
        """2 sin^2 of half the phase from one row to the next."""
        return np.asarray(2 * np.sin(np.pi * self.frequency * self.grid.stride * self.grid.dt) ** 2)

    def flat(self) -> float:
        """Return the least loss without a band."""
        ratio = float(np.mean(self.power / self.background))
        variance = self.background * ratio
        return float(0.5 * self.size * np.sum(np.log(variance) + self.power / variance))


def _window(view: View, beside: Beside, f0: float, width: float, shape: Shape) -> _Window:
    grid = view.grid
    unit = grid.rate_hz / (2 * grid.n)
    reach = max(12 * width, 400 * unit)
    low = int(max(0.2 * f0, f0 - reach) / unit)  # below, noise changes within a bin
    high = int(min(grid.n - 1, (f0 + reach) / unit))
    size = max(1, (high - low) // _SUB_BINS)
    stop = low + (high - low) // size * size
    f = grid.frequency[low:stop].reshape(-1, size).mean(axis=1)
    # The band passes the filters: what is measured is divided by how they change its form.
    passed = view.model.passing(np.append(f, f0))(shape(f0, width), np.ones(len(f) + 1))
    form = passed[:-1] / passed[-1]
    power = view.squares[low:stop].reshape(-1, size).mean(axis=1) / form
    # Far below a loud band a model without it may come to nothing.
    background = np.maximum(beside(f) / form, _NOTHING * power.max())
    return _Window(f, power, background, size, grid, shape)


def _gain(fit: Fitted) -> float:
    return fit[1].gain


def _is_hopeless(view: View, gain: float) -> bool:
    """Return whether no other shape, and no better background, will make up for the penalty."""
    return gain < _HOPELESS * (_looked_at(view) - float(np.log(ALPHA)))


def _has_one_shape(fit: Fitted) -> bool:
    """Return whether a band is so narrow that a line which wanders has the same spectrum."""
    band, gain = fit[0], fit[1].gain
    return gain < _SHAPELY and band.bandwidth.value < _ONE_SHAPE * band.frequency.value


def _fit(view: View, start: int, width: int) -> Fitted | None:
    """Return the likeliest shape; flat tops are looked for only where one could be seen."""

    def likeliest(shapes: tuple[Shape, ...]) -> Fitted | None:
        fits = (_fit_shape(view, start, width, shape) for shape in shapes)
        return max((fit for fit in fits if isinstance(fit, tuple)), key=_gain, default=None)

    first = _fit_shape(view, start, width, _resonance)
    if isinstance(first, _FaintLine):
        return None
    if first is not None and (_is_hopeless(view, _gain(first)) or _has_one_shape(first)):
        return first
    others = (first, likeliest((_wandering,)))
    best = max((fit for fit in others if fit is not None), key=_gain, default=None)
    if best is None or best[1].gain < _SHAPELY:
        return best
    if best[0].bandwidth.value * view.series.duration_s < _BROAD:
        return best
    flat = likeliest(tuple(_flat))
    return best if flat is None else max(best, flat, key=_gain)


@dataclass(frozen=True)
class _FaintLine:
    """What is as narrow as a line, where all shapes are one, and gains less than the penalty."""


def _fit_shape(view: View, start: int, width: int, shape: Shape) -> Fitted | _FaintLine | None:
    grid = view.grid
    unit = grid.rate_hz / (2 * grid.n)
    f0, w = (start + width / 2) * unit, max(width * unit * 0.5, 3 * unit)
    excess = view.squares[start : start + width] - view.spectrum.ordinates[start : start + width]
    point = np.array([0.0, np.log(max(float(excess.sum()) / grid.n, 1e-30)), f0, np.log(w)])
    beside: Beside = view.spectrum.at

    price = _looked_at(view) - float(np.log(ALPHA))

    def is_line(at: Array) -> bool:  # a loud tone may be a band again
        narrow = np.exp(at[3]) < _COLLAPSED * unit
        return bool(narrow and window.flat() - window.loss(at) < price)

    begin, rough = point, None
    for turn in range(_ROUNDS + 1):
        width_hz = float(np.exp(begin[3]))
        if turn != 1:  # which goes on from turn 0
            # What is beside the band is known only once the band is in the model.
            window = _window(view, beside, float(begin[2]), width_hz, shape)
        spread = np.diag([0.05, 0.3, 0.3 * width_hz, 0.3])
        is_rough = turn == 0
        x_within, within = (_ROUGHLY, _ROUGHLY) if is_rough else (1e-3 * width_hz, 1e-3)
        found = minimise(
            *(window.loss, begin, spread), x_within=x_within, within=within, turns=500,
            until=is_line, after=rough,
        )  # fmt: skip
        point, rough = found.x, found if is_rough else None
        f0, w = float(point[2]), float(np.exp(point[3]))
        if w < _NARROWEST * unit:
            return _FaintLine() if window.flat() - found.value < price else None
        if w > BROADEST * f0:
            return None
        band = shape(f0, w)
        whole = view.spectrum_with(band)
        gain = whole.loglik - view.spectrum.loglik
        if w < _RESOLVED * f0:  # a bin is as wide: the ordinates in the window know more
            gain = max(gain, window.flat() - found.value)
        if _is_hopeless(view, gain):
            break
        if not is_rough:
            begin, beside = point, partial(whole.of, whole.model.components[:-1])
    effect = _band(view, point[1:], _errors(window.loss, point)[1:])
    return effect, Candidate(effect, gain, _looked_at(view), parts=(band,))


def _band(view: View, at: Array, error: Array) -> Narrowband:
    """Return the band of a log variance, a frequency and a log width."""
    log_variance, frequency, log_width = at.tolist()
    return Narrowband(
        Estimate.of(frequency, error[1], "Hz"),
        Estimate.of_log(float(np.exp(log_width)), error[2], "Hz"),
        Estimate.of_log(float(np.exp(log_variance / 2)), error[0] / 2, view.unit),
    )


def _looked_at(view: View) -> float:
    return float(0.5 * np.log(4 * view.grid.n / ALPHA) + _PENALTY + np.log(ALPHA))


def band_elsewhere(
    view: View, frequency: Estimate, bandwidth: Estimate, questions: int
) -> Candidate:
    """Return what an axis has in a band that another axis has shown, whose form is known.

    Parameters
    ----------
    view : View
        Of the axis that is asked.
    frequency, bandwidth : Estimate
        Of the band.
    questions : int
        How many are asked together.
    """
    part = _resonance(frequency.value, bandwidth.value)
    spectrum = view.spectrum_with(part)
    gain = max(spectrum.loglik - view.spectrum.loglik, 0.0)
    component = spectrum.model.components[-1]
    size = spectrum.model.amplitude_behind(component, frequency.value)
    # Of a power that gains so much the error is this part, and that of its square root half of it.
    sigma = Estimate.of_log(max(size, 1e-300), 0.5 / np.sqrt(max(2 * gain, 1e-9)), view.unit)
    effect = Narrowband(frequency, bandwidth, sigma)
    return Candidate(effect, gain, float(np.log(questions)), parts=(part,))


def halved(view: View, candidate: Candidate, least: float) -> tuple[Candidate, Candidate] | None:
    """Return the two resonances that a band is; None where one explains it as well.

    Parameters
    ----------
    view : View
        Without the band.
    candidate : Candidate
        The band.
    least : float
        What two must gain over one, in nats.
    """
    one, part = candidate.effect, candidate.parts[0]
    if not isinstance(one, Narrowband) or not isinstance(part, Component):
        return None
    f0, width = one.frequency.value, one.bandwidth.value
    whole = view.with_parts(part)
    if width * view.series.duration_s < _SPLITTABLE:
        return None
    if misfit(whole, f0, _WITHIN * width)[0] < least / 2:
        return None
    beside = partial(whole.spectrum.of, whole.spectrum.model.components[:-1])
    single = _window(view, beside, f0, width, _shape_of(part))
    start = np.array([0.0, 2 * np.log(one.sigma.value), f0, np.log(width)])
    alone = _descend(single, start, width)
    half = np.array([start[1] - np.log(2), 0.0, np.log(0.7 * width)])
    pairs = []
    for shape in (_resonance, _wandering):
        two = replace(single, shape=shape)
        for apart in _APART:
            low, high = half.copy(), half.copy()
            low[1], high[1] = f0 - apart * width, f0 + apart * width
            pairs.append((two, _descend(two, np.concatenate([[0.0], low, high]), width)))
    window, best = min(pairs, key=lambda pair: pair[0].loss(pair[1]))
    if single.loss(alone) - window.loss(best) < least:
        return None
    errors = _errors(window.loss, best)
    found = []
    for own in (slice(1, 4), slice(4, 7)):
        band = window.shape(float(best[own][1]), float(np.exp(best[own][2])))
        other = best[2] if own.start > 1 else best[5]
        effect = replace(_band(view, best[own], errors[own]), overlaps=float(other))
        found.append(Candidate(effect, 0.0, _looked_at(view), parts=(band,)))
    both = view.accept(found[0]).accept(found[1]).spectrum.loglik
    first, second = (
        replace(c, gain=both - view.accept(other).spectrum.loglik)
        for c, other in (found, found[::-1])
    )
    return first, second


def _shape_of(part: Component) -> Shape:
    """Return the shape of a band by frequency and width."""
    return lambda f0, width: replace(part, sigma=1.0, frequency=f0, bandwidth=width)  # type: ignore[call-arg]


def _descend(window: _Window, start: Array, width: float) -> Array:
    """Return the least loss downhill from a point."""
    scale = np.ones(len(start))
    scale[2::3] = width

    least = window.loss(start)  # a change of a nat would be lost in so large a number

    def loss(x: Array) -> float:
        return window.loss(x * scale) - least

    return descend(loss, start / scale, step=1e-5, within=1e-7) * scale


def _errors(loss: Callable[[Array], float], at: Array) -> Array:
    """Return standard errors from the curvature of the log-likelihood.

    NaN at an end of what is allowed: a band whose centre wants to lie beyond is not measured.
    """
    bands = [(0.05, 0.05 * np.exp(log_width), 0.05) for log_width in at[3::3]]
    step = np.array([0.02, *(one for band in bands for one in band)])
    sides = (loss(at + sign * 2 * row) for row in np.diag(step) for sign in (-1, 1))
    if max(sides) >= _FORBIDDEN:
        return np.full(len(at), np.nan)
    return errors_at(loss, at, step)


def ordinate_correlation(data: Array) -> float:
    """Return how many neighbouring ordinates say the same because the noise is uneven.

    Noise that is loud in a tenth of the record has a spectrum that is smooth over ten ordinates: a
    run of ten high ones is then no more of a surprise than one.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> loud = np.where(np.arange(100_000) < 10_000, 10.0, 1.0)
    >>> round(ordinate_correlation(loud * rng.normal(size=100_000)))
    8
    """
    power = block_means(np.diff(data) ** 2, _PARTS)
    mean = float(np.mean(power))
    return max(1.0, float(np.mean(power**2)) / mean**2) if mean > 0 else 1.0
