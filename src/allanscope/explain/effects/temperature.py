r"""Dependence of the level on the measured temperature: in proportion, late, or in a curve.

.. math:: y = k \, (T_\ell - \bar T) + q \, (T_\ell - \bar T)^2, \qquad
          \ell \, \dot T_\ell = T - T_\ell , \quad T_\ell(0) = T(0)

:math:`AVAR_y = k^2 AVAR_T + 2 k ACOV_{yT}` where it is in proportion: in the curve it is a hump
where the room varies, swallowed by K. Spotted by GLS on the smoothed temperature (the converter's
noise would attenuate the slope), the noise refitted. A die that sits behind the thermometer's mass
follows with a lag :math:`\ell`; one that is used around the turning point of its parabola follows
in a curve, which swings twice as fast as the room. Each of the two is part of the answer only if it
gains its own price beyond what the simpler form gains. It repeats with every excursion of the room,
so quarters of the record must agree.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from allanscope.compiled import Pointer, kernel
from allanscope.explain.candidate import ALPHA, Candidate, HeldOut
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.heldout import interleaved
from allanscope.explain.regression import (
    Regression,
    joint_fit,
    likely_time,
    marginal_covariance,
    restricted_loglik,
)
from allanscope.explain.series import in_time
from allanscope.explain.view import View
from allanscope.optimise import minimise_between
from allanscope.quantities import TWO_SIDED_95

Array = NDArray[np.float64]

_SHORTEST_S, _LONGEST = 10.0, 0.2
"""Lags that are looked for; the longest as a share of the record: beyond, it is a drift."""
_BANK = 10
"""Lags tried, equally far apart in their logarithm; each is paid for."""
_LAG_PRICE = float(np.log(_BANK / ALPHA))
_CURVE_PRICE = float(-np.log(ALPHA))
_BETWEEN = 3.0
"""Nats that a lag between two of the bank may gain over both."""
_STEP = 0.05
"""Of ln lag, over which derivatives are taken."""
_LEAP = 0.4
"""Most that ln lag moves in one step of a joint regression."""
_AS_WELL = 0.9
"""Share of the gain of a line from which a curve takes its place: the temperature is known less
well than the level."""
_UPRIGHT = 0.9
"""Level in g of an axis so near the vertical that a tilt hardly moves it."""
_GRAVITY = (0.8, 1.2)
"""Size in g of the means of all axes of an accelerometer at rest, whatever its scale is off by."""
_FINER = 2
"""Times on which the temperature is followed, for every ordinate it has: its square has twice as
many."""

_DOUBLES, _DOUBLES_OUT = Pointer(np.float64, 1), Pointer(np.float64, 1, written=True)
_filter_bank = kernel(
    "filter_bank", _DOUBLES, _DOUBLES, int, float, _DOUBLES_OUT, _DOUBLES_OUT, int
)


@dataclass(frozen=True)
class Temperature(EffectKind):
    """The level follows the temperature.

    Attributes
    ----------
    slope : Estimate
        At the mean temperature of the record.
    lag : Estimate or None
        Time constant in s with which the level follows; None where the data bear none out.
    curvature : Estimate or None
        Factor of the square of the temperature less its mean; None where there is none.
    temperature_span_c, temperature_mean_c : float
        Of the record.
    level_g : float or None
        Mean of an axis of an accelerometer whose axes together show gravity: a board that tilts
        with the temperature moves it by sqrt(1 - level^2) g per radian, as a bias would. None for
        other axes.
    """

    slope: Estimate
    lag: Estimate | None
    curvature: Estimate | None
    temperature_span_c: float
    temperature_mean_c: float
    level_g: float | None = None

    kind = "temperature"
    meaning = "the level follows the measured temperature"
    phrase = "temperature dependence, {slope}"
    as_cause = "the temperature"
    acts_fast = False
    has_one_cause = True
    sized_by = "slope"
    is_slow = True
    is_drift = True
    is_thermal = True
    is_single = True
    must_replicate = True
    needs = frozenset({"temperature"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "warm_up": "self-heating looks alike: the temperature must explain more than the clock",
        "ramp": "the temperature may drift in a straight line too",
        "sinusoid": "a room that swings around the turning point of a parabola is a line as well",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        words = f"the level follows the temperature with {self.slope.text}"
        if self.lag is not None:
            words += f", with a lag of {self.lag.value:.3g} s"
        if self.curvature is not None:
            words += f", in a curve of {self.curvature.text}"
        if self.level_g is not None and abs(self.level_g) < _UPRIGHT:
            tilt = abs(self.slope.value) / np.sqrt(1 - self.level_g**2)
            words += f", or the board tilts by {np.degrees(tilt):.2g} deg/degC"
        return words

    @property
    def form_price(self) -> float:
        """What a lag and a curve had to gain, beyond what found the slope."""
        late, bent = self.lag is not None, self.curvature is not None
        return late * _LAG_PRICE + bent * _CURVE_PRICE

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Fit a slope, then a lag and a curvature where each gains its price."""
        thermal, measured = view.series.thermal, view.series.temperature_c
        assert thermal is not None
        assert measured is not None
        unit = Estimate(1.0, unit=f"{view.unit}/degC")
        of_record = float(np.ptp(thermal)), float(np.mean(measured)), _level(view)
        plain = cls(unit, None, None, *of_record)
        return [plain.extended(view)]

    @classmethod
    def instead_of(cls, view: View, candidate: Candidate) -> Candidate | None:
        """Return the level in a curve over the temperature, where that explains as much.

        A room that swings around the turning point of a parabola makes the level swing twice as
        fast, at constant amplitude: a line, if one looks at the level alone.
        """
        if not candidate.effect.resembles_bend or view.series.thermal is None or view.drifts:
            return None
        found = next(iter(cls.candidates(view)), None)
        if found is None or found.excess <= 0 or found.gain <= _AS_WELL * candidate.gain:
            return None
        bent = isinstance(found.effect, cls) and found.effect.curvature is not None
        return found if bent else None

    def refine(self, view: View) -> Candidate:
        """Estimate it again, with what has become visible of its lag and its curve."""
        return replace(self, lag=None, curvature=None).extended(view)

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Follow the temperature with the numbers that are known."""
        if view.series.thermal is None:
            return candidate
        return replace(candidate, signal=self.signal(view))

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut | None:
        """Judge the slope and the curvature by interleaved blocks."""
        del candidate
        columns = self.terms(view)
        return interleaved(view, joint_fit(view, columns), columns, recurs=True, slow=True)

    def columns(self, view: View) -> Array:
        """Return the ordinates of the temperature and its square, and their change with ln lag."""
        terms = self.terms(view)
        if self.lag is None:
            return terms
        earlier, later = (
            replace(self, lag=replace(self.lag, value=self.lag.value * factor)).terms(view)
            for factor in (np.exp(-_STEP), np.exp(_STEP))
        )
        change = (later - earlier) / (2 * _STEP)
        bent = self.curvature.value / self.slope.value if self.curvature is not None else 0.0
        moved = change[0] + (bent * change[1] if len(change) > 1 else 0.0)
        return np.vstack([terms, moved])

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return slope, curvature and lag that a joint regression found."""
        error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        slope, lag, curvature = float(amplitude[0]), self.lag, self.curvature
        if lag is not None:
            size = slope or 1e-300
            step = float(np.clip(amplitude[-1] / size, -_LEAP, _LEAP))
            time = float(np.clip(lag.value * np.exp(step), *_bounds(view)))
            lag = Estimate.of_log(time, float(error[-1]) / abs(size), "s")
        if curvature is not None:
            curvature = Estimate.of(float(amplitude[1]), float(error[1]), f"{view.unit}/degC^2")
        found = replace(
            self,
            slope=Estimate.of(slope, float(error[0]), self.slope.unit),
            lag=lag,
            curvature=curvature,
        )
        return candidate.solved(found, partial(found.signal, view))

    def signal(self, view: View) -> Array:
        """Return what it adds to the samples, shape (n,)."""
        size = [self.slope.value, *([self.curvature.value] if self.curvature is not None else [])]
        return in_time(np.array(size) @ self.terms(view), view.grid.n)

    def terms(self, view: View) -> Array:
        """Return the ordinates of the temperature as it is felt and, for a curve, its square."""
        ordinates = view.series.thermal_ordinates
        assert ordinates is not None
        lag = 0.0 if self.lag is None else self.lag.value
        bent, known = self.curvature is not None, view.series.temperature_ordinates
        found = known.get((lag, bent))
        if found is None:
            found = _terms(view, ordinates, lag, bent)
            if lag in _lags(view):  # those that every axis is asked for again and again
                known[lag, bent] = found
        return found

    def extended(self, view: View) -> Candidate:
        """Return the likeliest of the forms that pay for what they have more than a slope."""
        best = self
        refused: Callable[[Temperature, View, float], Temperature] | None = None
        gain = best.gain(view)
        for extend, paid in ((_late, _LAG_PRICE), (_bent, _CURVE_PRICE), (_late, _LAG_PRICE)):
            if extend is refused:
                continue  # nothing has changed since
            trial = extend(best, view, gain + paid)
            more = trial.gain(view) - gain if trial is not best else 0.0
            if more > paid:
                best, gain, refused = trial, gain + more, None
            else:
                refused = refused or extend
        if best.lag is not None and best.curvature is not None:
            best = _late(replace(best, lag=None), view, 0.0)  # the one was found without the other
        return best.ranked(view)

    def gain(self, view: View) -> float:
        """Return what it gains, sizes and noise fitted."""
        return joint_fit(view, self.terms(view), rounds=5).gain

    def ranked(self, view: View) -> Candidate:
        """Fit the sizes and the noise together."""
        fit = joint_fit(view, self.terms(view))
        bare = Candidate(self, fit.gain, self.form_price)
        return replace(bare, finish=partial(self._finished, view, bare, fit))

    def _finished(
        self, view: View, bare: Candidate, fit: Regression
    ) -> tuple[EffectKind, Array | None]:
        """Return the effect with the errors of its numbers, and its signal."""
        sizes = [*fit.amplitude, *([0.0] if self.lag is not None else [])]
        sized = replace(self, slope=replace(self.slope, value=float(fit.amplitude[0])))
        if self.curvature is not None:
            value = float(fit.amplitude[1])
            sized = replace(sized, curvature=replace(self.curvature, value=value))
        columns = sized.columns(view)
        m = columns.shape[1]
        weight = fit.spectrum.kept[:m] / fit.spectrum.first(m)
        known = replace(
            fit,
            amplitude=np.array(sizes),
            covariance=np.asarray(np.linalg.pinv((columns * weight) @ columns.T, hermitian=True)),
        )
        covariance = marginal_covariance(view, columns, known)
        done = sized.solved(view, bare, known.amplitude, covariance).finished()
        assert isinstance(done.effect, Temperature)
        return done.effect.with_interval(view), done.signal

    def with_interval(self, view: View) -> Temperature:
        """Return it with the interval that holds 95 % of its lags, by their restricted likelihood.

        Few swings of the room tell a lag: half of one is farther off than twice of it is.
        """
        if self.lag is None or self.lag.upper is None:
            return self

        def loglik(lag: float) -> float:
            return restricted_loglik(view, replace(self, lag=Estimate(lag, unit="s")).terms(view))

        error = float(np.log(self.lag.upper / self.lag.value)) / TWO_SIDED_95
        return replace(self, lag=likely_time(self.lag, loglik, error))


def _level(view: View) -> float | None:
    """Return the mean of an axis of an accelerometer that shows gravity; None of any other."""
    size = view.series.acceleration if view.unit == "g" else None
    seen = size is not None and _GRAVITY[0] < size < _GRAVITY[1]
    return float(view.samples.mean()) if seen else None


def _bounds(view: View) -> tuple[float, float]:
    """Return the shortest and the longest lag that is looked for."""
    return _SHORTEST_S, max(_SHORTEST_S, _LONGEST * view.series.duration_s)


@lru_cache(maxsize=1)
def _bank(shortest: float, longest: float) -> tuple[float, ...]:
    return tuple(np.geomspace(shortest, longest, _BANK).tolist())


def _lags(view: View) -> tuple[float, ...]:
    """Return the lags that are tried first."""
    return _bank(*_bounds(view))


def _late(effect: Temperature, view: View, least: float) -> Temperature:
    """Return the effect with the likeliest lag; itself where it has one, or none is to be seen.

    None is where the best of a few lags gains too little for one between them to gain `least`.
    """
    shortest, longest = _bounds(view)
    if effect.lag is not None or longest < 2 * shortest:
        return effect

    def at(lag: float) -> Temperature:
        return replace(effect, lag=Estimate(lag, unit="s"))

    bank = _lags(view)
    gains = [at(lag).gain(view) for lag in bank]
    best = int(np.argmax(gains))
    if best == _BANK - 1:  # it wants to be slower than the record can tell
        return effect
    if gains[best] < least - _BETWEEN:
        return effect
    low, high = np.log([bank[max(0, best - 1)], bank[best + 1]]).tolist()
    found, _ = minimise_between(lambda x: -at(float(np.exp(x))).gain(view), low, high, within=0.01)
    return at(float(np.exp(found)))


def _bent(effect: Temperature, view: View, least: float) -> Temperature:
    """Return the effect with a curvature."""
    del least
    return replace(effect, curvature=Estimate(1.0, unit=f"{view.unit}/degC^2"))


def _terms(view: View, ordinates: Array, lag: float, bent: bool) -> Array:
    """Return the first ordinates of the temperature behind a lag and, for a curve, its square.

    What is slow needs no more times than it has ordinates: the temperature is followed on those.
    """
    n, m = view.grid.n, view.grid.low
    if lag == 0.0 and not bent:
        return ordinates[np.newaxis, :m]
    coarse = min(n, _FINER * m)
    felt = in_time(ordinates[: min(m, coarse - 1)], coarse) * np.sqrt(coarse / n)
    if lag > 0.0:
        felt = _lagged(felt, lag * view.grid.rate_hz * coarse / n)
    terms = [felt, (felt - felt.mean()) ** 2] if bent else [felt]
    found = np.zeros((len(terms), m))
    for row, term in zip(found, terms, strict=True):
        own = np.asarray(dct(term, norm="ortho"))[1 : m + 1] * np.sqrt(n / coarse)
        row[: len(own)] = own
    return found


def _lagged(x: Array, lag: float) -> Array:
    """Return a signal behind a first-order lag in samples, in balance at its start.

    Exact for a signal that is straight between the samples.

    >>> _lagged(np.array([0.0, 1.0, 1.0, 1.0]), 1.0).round(3)
    array([0.   , 0.368, 0.767, 0.914])
    """
    keep = float(np.exp(-1 / lag))
    mean = lag * (1 - keep)  # of the exponential over a step
    past: Array = np.concatenate([mean * x[:1], x[:-1]])
    pole, weight, level = np.array([keep]), np.array([mean * (1 - keep)]), x[:1] / (1 - keep)
    _filter_bank(pole, weight, 1, 0.0, level, past[1:], len(x) - 1)
    return (1 - mean) * x + past
