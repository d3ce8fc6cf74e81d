r"""A low-pass: the sensor's own filter, or one behind it, cuts the top of the band.

Spotted as a deficit towards Nyquist by Whittle likelihood. The order is not known, so a family is
fitted, :math:`|H|^2 = 1 / (1 + (g(f)/g(f_c))^{2p})`, with g = sin (one pole in the sampled data, or
an analog one aliased), tan (Butterworth by the bilinear transform) and f itself, p free; where the
deficit is so large that its form can be told, an average as well (`noise.filters.low_pass`): that
of a converter, and the mean of the last k rows, for every k within a factor of the cutoff. For one
pole the cutoff is that of its time constant, which may lie beyond Nyquist; otherwise it is
where the response is down by 3 dB. What an amplifier or a converter adds behind a filter of more
than one pole is a floor of white noise (behind one pole the two are Gauss-Markov noise beside white
noise). It enters the model as a factor on the white noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import ALPHA, Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind, errors_at
from allanscope.explain.effects.narrowband import ordinate_correlation
from allanscope.explain.residual import band_scores, removes
from allanscope.explain.stationarity import UNSTEADY, bartlett_z_of
from allanscope.explain.view import View
from allanscope.noise.components import Floor
from allanscope.noise.filters import (
    AnalogueLowPass,
    Averaging,
    Butterworth,
    LowPass,
    MovingAverage,
    OnePole,
)
from allanscope.noise.selection import LOW_PASS_PENALTY
from allanscope.optimise import minimise
from allanscope.quantities import CHI_SQUARE_95, TWO_SIDED_95

Array = NDArray[np.float64]

_STEPS = (0.01, 0.001, 0.0001)
"""Of ln cutoff and ln order, over which the likelihood is a parabola: the first that is within the
error. Where the deficit is deep, zeros of the response move through the top of the band."""
_UNKNOWN = 10.0
"""Standard error of ln cutoff beyond which nothing is known."""
_BURSTS = 1e-3
"""Sigma of unsteadiness a nat of the gain, where one is some ten nats: about a hundredth."""
_FOLLOWED, _FITS_Z = 1e-2, 4.0
"""The same where no band is off the response by so many standard errors: rows that were resampled
have noise at the top of the band that comes and goes, and a mean that the filter describes."""
_COUNTED = 1e-4
"""The same of an average over rows, which are counted."""
_ORDERS = (1.0, 12.0)
"""Of a filter whose response decays: its powers begin with f^2. Below 1 it would lower the density
far below the cutoff, and raise N in return."""
_SHAPELY = 300.0
"""Gain in nats from which an average can be told from the others."""
_AS_LIKELY = CHI_SQUARE_95 / 2
"""Nats by which a filter of another family may be behind to be as good an answer."""
_BEHIND = 30.0
"""Nats by which a rough fit of a filter may be behind that of another to be followed."""
_AS_WELL = 3.0
"""Nats within which two descriptions do as well."""
_LITTLE = 0.3
"""Of the N before the filter, below which no white noise is left."""
_FLOOR_GAINS, _POLES, _FAINT = 10.0, 1.4, 0.02
"""Nats that a floor behind a low-pass must gain; the order of that below which it may be one pole,
whose noise beside a floor is Gauss-Markov noise as well: the floor must then gain no more than this
part of what the low-pass gains alone."""
_COUNT, _HOLLOW = 100, 0.5
"""Ordinates in a band, and measured over model there, below which the band is empty."""
_RIPPLED, _ROUGHLY = 30.0, 0.02
"""Gain in nats from which an average over rows is looked for, whose ripples no other response has;
part of its own gain by which one over any time may be likelier and no better."""
_TOP = 0.499
"""Highest cutoff near which it may lie, as a share of the rate."""
_NEAR = 4.0
"""Factor from the cutoff of the likeliest other response within which averages over rows lie."""
_HALF_POWER = 0.443
"""Rows of an average times its cutoff, as a share of the rate."""
_LONGEST = 256
"""Most rows that are averaged."""
_SMEARED = 1e-3
"""Least response in a bin, of which the middle may lie at a zero."""
_LIKELIEST = 3
"""Averages over rows of which the likelihood is computed in full."""
_CUTOFFS = (0.02, 0.05, 0.1, 0.18, 0.28, 0.38, 0.46, 0.7)
"""Cutoffs tried first, as shares of the rate."""
_HOPELESS = -2.0
"""Gain in nats of the best of them below which none between them passes: of those that gained 8 in
the end, the best had gained 8."""


@dataclass(frozen=True)
class _Family:
    """A response, the order at which its search starts, and how high its cutoff may lie."""

    low_pass: type[LowPass]
    order: float | None
    highest: float

    def at(self, point: Array) -> LowPass:
        return self.low_pass(*(float(v) for v in np.exp(np.clip(point, -12, 12))))

    def loss(self, view: View, point: Array) -> float:
        cutoff, *order = np.exp(np.clip(point, -12, 12))
        if order and not (
            _ORDERS[0] <= order[0] < _ORDERS[1] and cutoff < self.highest * view.grid.rate_hz
        ):
            return 1e12
        return -view.loglik_with(self.at(point))

    def starts(self, cutoffs: list[float]) -> list[Array]:
        return [np.log([c] if self.order is None else [c, self.order]) for c in cutoffs]


_FAMILIES = (
    _Family(OnePole, None, np.inf),
    _Family(Butterworth, 2.0, 0.499),
    _Family(AnalogueLowPass, 1.0, 2.0),
)
"""Filters of sensors, with the order and the highest cutoff (as a share of the rate) they start
from."""
_AVERAGING = _Family(Averaging, 2.0, 0.499)
"""Tried only where one of them was found: its zeros lie where their slope ends."""


@dataclass(frozen=True)
class BandLimit(EffectKind):
    """A low-pass filter."""

    cutoff: Estimate
    order: float | None = None
    response: str | None = None
    rows: int | None = None
    floor: float | None = None

    kind = "band_limit"
    meaning = "a low-pass cuts the white noise"
    phrase = "low-pass at {cutoff}"
    as_cause = "a low-pass at {cutoff} Hz"
    is_counted = True
    acts_slow = False
    is_single = True
    is_process = True
    excluded_by = frozenset({"Q"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "repeated_samples": "rows that repeat are counted, and the deficit has another shape",
        "gauss_markov": "leaves the top of the band flat",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        cutoff = f"a cutoff of {self.cutoff.value:.3g} Hz"
        if self.rows is not None:
            return f"a moving average over {self.rows} rows, a low-pass with {cutoff}"
        behind = "" if self.floor is None else ", and white noise behind it"
        return f"a low-pass with {cutoff}{behind}"

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Fit every family from several cutoffs, if at any of them it does not lose too much."""
        starts = _starts(view)
        losses = (one.loss(view, at) for one in _FAMILIES for at in one.starts(starts))
        if -min(losses) - view.spectrum.loglik < _HOPELESS:
            return []
        best = _best(view, starts)
        weaker = replace(best, gain=best.gain / ordinate_correlation(view.data))
        return [best if weaker.excess > 0 else weaker]

    def refine(self, view: View) -> Candidate:
        """Estimate the cutoff again."""
        return _best(view, [self.cutoff.value])

    def adequate(self, view: View, candidate: Candidate) -> Candidate | None:
        """Return whether it removes its part of the residual and is there all along.

        What comes and goes more than a filter may is what a tone in it bends; bursts beside the
        tone do so too, but by little against what the filter gains, and a tone has another form.
        """
        if not removes(view, candidate):
            return None
        unsteady = bartlett_z_of(view, candidate)
        if unsteady <= max(2 * UNSTEADY, _BURSTS * candidate.gain):
            return candidate
        if unsteady > _FOLLOWED * candidate.gain:
            return None
        off = np.abs(band_scores(view.with_parts(*candidate.parts)).z)
        return candidate if float(off.max()) < _FITS_Z else None


def low_pass_instead(view: View, process: Candidate) -> Candidate | None:
    """Return the low-pass that a process is which leaves no white noise beside it; None else.

    Noise that bends down and white noise behind a filter have the same spectrum where no white
    noise is left to lie flat above the bend: the process has then one number more for nothing. A
    sensor always has white noise, so it is the filter that is named, and the process its rival.
    """
    if not BandLimit.has_place(view):
        return None
    left = view.spectrum_with(*process.parts).model.value("N")
    found = _best(view, _starts(view), floor=False)
    white = view.spectrum_with(*found.parts).model.value("N")
    if found.gain <= process.gain - max(_AS_WELL, _FAINT * process.gain) or left >= _LITTLE * white:
        return None
    low_pass = found.effect.adequate(view, found)
    if low_pass is None:
        return None
    return replace(low_pass, rivals={**low_pass.rivals, process.kind: process.gain})


def _starts(view: View) -> list[float]:
    return [share * view.grid.rate_hz for share in _CUTOFFS]


def _best(view: View, cutoffs: list[float], floor: bool = True) -> Candidate:
    """Fit every family from the most promising of the cutoffs and take the most likely."""
    families = _fitted(view, _FAMILIES, cutoffs)
    loss, found = families[0]
    gain = -loss - view.spectrum.loglik
    if gain > _SHAPELY:
        other, averaging = _fitted(view, (_AVERAGING,), [found.cutoff], loss)[0]
        loss, found = min((loss, found), (other, averaging), key=lambda one: one[0])
    if gain > _RIPPLED:
        other, averaging = _over_rows(view, min(found.cutoff, _TOP * view.grid.rate_hz))
        as_well = max(_AS_WELL, _ROUGHLY * (-other - view.spectrum.loglik))
        if other < loss + as_well * isinstance(found, Averaging):
            loss, found = other, averaging
    if gain > _SHAPELY and floor and (floored := _with_floor(view, found.cutoff, loss)):
        return floored
    others = (one for lost, one in families if one is not found and lost < loss + _AS_LIKELY)
    return _candidate(view, found, *others)


def _with_floor(view: View, cutoff: float, loss: float) -> Candidate | None:
    """Return a low-pass of more than one pole with white noise behind it, if that is likelier.

    Loud tones below a cutoff and the noise above it are as likely to be one, but noise that passes
    leaves nothing empty between them.
    """
    beside = view.with_parts(Floor(1.0))
    other, found = _fitted(beside, _FAMILIES, [cutoff, cutoff / 2])[0]
    more, alone = loss - other, -loss - view.spectrum.loglik
    one_pole = isinstance(found, OnePole) or found.values[1] < _POLES
    if more < _FLOOR_GAINS or (one_pole and more > _FAINT * alone):
        return None
    both = beside.with_parts(found)
    level = both.spectrum.model.value("floor")
    if not 0.0 < level < _LITTLE * both.spectrum.model.value("N"):
        return None
    bands = band_scores(both)
    if np.any(bands.ratio[bands.count > _COUNT] < _HOLLOW):
        return None
    candidate = _candidate(beside, found)
    assert isinstance(candidate.effect, BandLimit)
    return replace(
        candidate,
        effect=replace(candidate.effect, floor=level),
        gain=beside.loglik_with(found) - view.spectrum.loglik,
        parts=(found, Floor(1.0)),
    )


def _over_rows(view: View, cutoff: float) -> tuple[float, LowPass]:
    """Return the likeliest average over rows near a cutoff, and what it loses.

    A choice among many costs its logarithm. They are ranked by white noise alone behind each.
    """
    dt, grid = view.grid.dt, view.grid
    middle = _HALF_POWER / (cutoff * dt)
    least, most = (int(np.clip(k, 2, _LONGEST)) for k in (middle / _NEAR, middle * _NEAR))
    kept = (grid.centre > cutoff / _NEAR) & (grid.counts(view.excluded) > 0)
    dof, power = grid.counts(view.excluded)[kept], view.power[kept]

    def alone(average: MovingAverage) -> float:
        response = average.response(grid.centre[kept], dt) + _SMEARED
        level = np.sum(dof * power / response) / np.sum(dof)
        return float(np.sum(dof * np.log(level * response)))

    averages = [MovingAverage.over(rows, dt) for rows in range(least, most + 1)]
    likeliest = sorted(averages, key=alone)[:_LIKELIEST]
    best = max(likeliest, key=view.loglik_with)
    return float(np.log(len(averages))) - view.loglik_with(best), best


def _fitted(
    view: View, families: Sequence[_Family], cutoffs: list[float], least: float = np.inf
) -> list[tuple[float, LowPass]]:
    """Return what the filters of some families lose, likeliest first; a free order costs a nat.

    What is far from its penalty, or from another (or from `least`), is not followed to the last
    digit.
    """
    trials = []
    for family in families:
        loss = partial(family.loss, view)
        first = min(family.starts(cutoffs), key=loss)
        steps = 0.15 * np.eye(len(first))
        rough = minimise(loss, first, steps, x_within=0.05, within=0.5, turns=120)
        exact = partial(minimise, loss, first, steps, within=1e-3, turns=120, after=rough)
        trials.append((family, rough, exact))
    least = min(least, *(rough.value for _, rough, _ in trials))
    most = min(least + _BEHIND, -view.spectrum.loglik - LOW_PASS_PENALTY / 2)
    fitted = []
    for family, rough, exact in trials:
        found = exact() if rough.value < most else rough
        fitted.append((found.value + (family.order is not None), family.at(found.x)))
    return sorted(fitted, key=lambda one: one[0])


def _candidate(view: View, low_pass: LowPass, *as_likely: LowPass) -> Candidate:
    """Return a low-pass; where others are as likely, its cutoff may be that of each."""
    order = low_pass.values[1] if len(low_pass.values) > 1 else 1.0
    ends = [
        np.log(one.cutoff) + TWO_SIDED_95 * _error(view, one) * np.array([-1.0, 1.0])
        for one in (low_pass, *as_likely)
    ]
    effect = BandLimit(
        Estimate(low_pass.cutoff, float(np.exp(np.min(ends))), float(np.exp(np.max(ends))), "Hz"),
        order,
        type(low_pass).__name__,
        low_pass.rows if isinstance(low_pass, MovingAverage) else None,
    )
    gain = view.loglik_with(low_pass) - view.spectrum.loglik
    looked_at = LOW_PASS_PENALTY + float(np.log(ALPHA))
    return Candidate(effect, gain, looked_at, parts=(low_pass,))


def _error(view: View, low_pass: LowPass) -> float:
    """Return the standard error of ln cutoff; the order, where it is free, goes along with it.

    That of an average over rows is known: they are counted.
    """
    if not low_pass.values:
        return _COUNTED

    def loss(point: Array) -> float:
        return -view.loglik_with(low_pass.with_values(np.exp(point).tolist()))

    point = np.log(low_pass.values)
    for step in _STEPS if -loss(point) - view.spectrum.loglik > _SHAPELY else _STEPS[:1]:
        error = float(errors_at(loss, point, np.full(len(point), step))[0])
        if error > step:
            break
    return min(error, _UNKNOWN)
