"""One draw of each study of `rank_calibration.py`: a truth, a record, and the ranks that follow.

The rank of a truth is the confidence that is placed below it. Between its ends an interval is taken
for half a normal on each side, of the logarithm where the interval is that of one, and for half an
exponential of the instant of a jump (Hinkley, Biometrika 57, 1970), or evenly distributed where it
is known to a row. The border of louder noise has no such shape: its rank is read off the likelihood
of the rows from which its interval is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from unittest.mock import patch

import numpy as np
from blind_noise import Array
from efficiency import RATE, simulate
from rank_effects import STUDIES, Hidden, Hider
from rank_streams import BLOCK_S, ONSETS, onset, rate
from scipy.optimize import brentq
from scipy.stats import chi2, norm
from scipy.stats import t as student

from allanscope.clock.rate import ORDINATES
from allanscope.explain import Effect, Parameter, explain
from allanscope.explain.effects import KINDS, variance_change
from allanscope.explain.given_detection import conditional_rank
from allanscope.explain.noise_level_border import confidence_of_loglik, rows_of_loglik
from allanscope.history import History
from allanscope.noise import NoiseFit, fit_noise
from allanscope.noise.drift import ramp_pattern
from allanscope.noise.evidence import Ordinates
from allanscope.noise.likelihood import Fit, Likelihood
from allanscope.noise.selection import Q_PENALTY
from allanscope.quantities import TWO_SIDED_95

DETECTED, RAMP = 9.55, 2 * np.log(1e3)
"""Twice the nats at which a coefficient, and a ramp, count as detected."""
RAMP_LIMIT = 1.1
"""What the profile of a ramp is divided by (`allanscope.noise.drift`)."""
NORMAL = 0.03
"""Relative standard deviation below which the fit takes a profile for normal."""
RAMP_HZ = 26.0
CORRECTED = "size given detection"
JUMPS, BORDERS = {"time", "duration"}, {"start", "stop"}
READ_OFF = {"intervals", "count", "level", "width", "step"}
"""Whole numbers, and values of a lattice: an interval holds them or not, and has no inside."""
COEFFICIENTS = {"N, B, K": (26.0, 1200.0), "N, B, K of 12 h": (13.0, 43200.0)}


@dataclass(frozen=True)
class Outcome:
    """What came of one draw.

    Attributes
    ----------
    d : float
        Size of what was hidden, in standard errors; NaN where it has none.
    found : int
        2 where it was named right, 1 where something else was named, 0 where nothing was.
    gain, price : float
        Nats that it gained and had to exceed; NaN where it was not found or is read off.
    ranks : dict
        Parameter to the rank of its truth; empty where it was not found.
    """

    d: float = np.nan
    found: int = 0
    gain: float = np.nan
    price: float = np.nan
    ranks: Mapping[str, float] = field(default_factory=dict)


Draw = Callable[[np.random.Generator], Outcome]


def coefficients(rate: float, duration: float) -> Draw:
    """Return what draws N, B and K, and finds their ranks in a fit."""

    def draw(rng: np.random.Generator) -> Outcome:
        n = int(rate * duration)
        truth = {"N": 4e-3, "B": 1.2e-3 * spread(rng, 3.0), "K": 1e-4 * spread(rng, 3.0)}
        scale = np.sqrt(rate / RATE)  # that of `simulate`
        fit = fitted(simulate(n, rng, scaled(truth, scale)), rate)
        found = {name: rank_of_coefficient(fit, name, truth[name]) for name in "NBK"}
        return Outcome(found=2, ranks={k: v for k, v in found.items() if v is not None})

    return draw


def scaled(truth: dict[str, float], scale: float) -> dict[str, float]:
    """Return the coefficients that `simulate` makes the same noise of at another rate."""
    return {"N": truth["N"] * scale, "B": truth["B"], "K": truth["K"] / scale}


def quantization(rng: np.random.Generator) -> Outcome:
    """Draw Q, the size of white angle noise, beside N."""
    rate, duration = 104.0, 300.0
    n, q = int(rate * duration), 6e-5 * spread(rng, 3.0)
    angles = rng.standard_normal(n + 1)
    samples = 4e-3 * np.sqrt(rate) * rng.standard_normal(n) + q * rate * np.diff(angles)
    rank = rank_of_coefficient(fitted(samples, rate), "Q", q)
    return Outcome() if rank is None else Outcome(found=2, ranks={"Q": rank})


def ramp(rng: np.random.Generator) -> Outcome:
    """Draw R, beside N, B and K."""
    slope = 1e-5 * spread(rng, 4.0)
    fit = fitted(with_ramp(rng, slope), RAMP_HZ)
    if not fit.coefficients["R"].detected:
        return Outcome()
    return Outcome(found=2, ranks={"R": rank_of_ramp(fit, slope)})


def with_ramp(rng: np.random.Generator, slope: float) -> Array:
    """Return twenty minutes with a ramp."""
    n = int(1200 * RAMP_HZ)
    truth = {"N": 4e-3, "B": 1.2e-3 * spread(rng, 3.0), "K": 1e-4 * spread(rng, 3.0)}
    samples = simulate(n, rng, scaled(truth, np.sqrt(RAMP_HZ / RATE)))
    return samples + slope * np.arange(n) / RAMP_HZ


def rank_of_ramp(fit: NoiseFit, slope: float) -> float:
    """Return the confidence below a slope, given that a ramp was detected.

    The noise is known from few ordinates: of m degrees of freedom the profile falls as
    m ln(1 + t^2 / m), of which the end of the interval and the gain over no ramp tell m. For each
    noise that they allow the slope is normal and truncated where it is detected.
    """
    size, half = abs(fit.slope), fit.coefficients["R"].upper - abs(fit.slope)
    none = [
        part.less(-fit.slope * ramp_pattern(part)) if isinstance(part, Ordinates) else part
        for part in fit.evidence
    ]
    held = Likelihood(none).maximise(fit.fit.model, held=fit.fit.held)
    lost = 2 * (fit.fit.loglik - held.loglik) / RAMP_LIMIT

    def fallen(m: float) -> float:
        return m * float(np.log1p((size / half) ** 2 * np.expm1(TWO_SIDED_95**2 / m))) - lost

    most, least = 1e3, 0.6
    m = least if fallen(least) > 0 else most if fallen(most) < 0 else brentq(fallen, least, most)
    error = half / np.sqrt(m * np.expm1(TWO_SIDED_95**2 / m))
    limit = min(error * np.sqrt(m * np.expm1(RAMP / RAMP_LIMIT / m)), size)
    errors = error * np.sqrt(m / chi2.ppf((np.arange(200) + 0.5) / 200, m))
    truth = slope * np.sign(fit.slope)
    return float(np.mean(norm.cdf((truth - size) / errors) / norm.cdf((truth - limit) / errors)))


def effect(study: str) -> Draw:
    """Return what hides one effect, and finds the ranks of its numbers."""

    def draw(rng: np.random.Generator) -> Outcome:
        hidden: Hidden = getattr(Hider(rng), study)()
        nominal, measured = hidden.clock or (None, None)
        borders: list[Array] = []
        with patch.object(variance_change, "rows_of_loglik", kept(rows_of_loglik, borders)):
            result = explain(hidden.record, nominal_hz=nominal, rate_fit=measured)
        effects = result.axes["gx"].effects
        found = nearest(hidden, effects)
        if found is None:
            return Outcome(hidden.d, int(bool(effects)))
        known = {k: v for k, v in hidden.truth.items() if k in found.parameters}
        row = 1 / hidden.rate
        ranks = {k: rank_of_number(k, found.parameters[k], v, row) for k, v in known.items()}
        ranks |= {
            k: rank_of_border(found.parameters[k], known[k], hidden.rate, borders)
            for k in BORDERS & known.keys()
        }
        gain, price = found.evidence["gain_nats"], found.evidence["price_nats"]
        size = KINDS[hidden.kind].sized_by
        if size in known:
            given = found.given_detection or found.parameters[size]
            ranks[CORRECTED] = rank_of_parameter(given, known[size])
        gain = np.nan if gain is None else gain
        return Outcome(hidden.d, 2, gain, price, {k: v for k, v in ranks.items() if v is not None})

    return draw


def kept(function: Callable[[Array], object], given: list[Array]) -> Callable[[Array], object]:
    """Return a function that also notes what it is given."""

    def noted(values: Array) -> object:
        given.append(values)
        return function(values)

    return noted


def clock(rng: np.random.Generator) -> Outcome:
    """Draw the rate of a stream: its sigma is known from few ordinates (Student's distribution)."""
    true, (value, _, upper) = rate(rng)
    away = (true - value) / (upper - value) * student.ppf(0.975, ORDINATES)
    return Outcome(found=2, ranks={"rate": float(student.cdf(away, ORDINATES))})


def begun(kind: str) -> Draw:
    """Return what lets something begin in a stream, and finds the ranks of its moment."""

    def draw(rng: np.random.Generator) -> Outcome:
        made = onset(kind, rng)
        own = [one for one in made.events if one.kind == kind]
        own.sort(key=lambda one: abs(one.occurrences[0].onset_s - made.at_s))
        if not own:
            return Outcome(found=int(bool(made.events)))
        first = own[0].occurrences[0]
        moment = Parameter(first.onset_s, first.lower_s, first.upper_s)
        # That of a jump is half an exponential on each side, unless it is known within a block.
        is_sharp = kind == "ramp" or first.upper_s - first.lower_s < 2 * BLOCK_S
        ranks = {"onset": rank_of_parameter(moment, made.at_s, 0.0 if is_sharp else BLOCK_S)}
        if own[0].frequency_hz is not None and own[0].frequency_interval_hz is not None:
            line = Parameter(own[0].frequency_hz, *own[0].frequency_interval_hz)
            ranks["frequency"] = rank_of_parameter(line, made.frequency_hz)
        known = {name: rank for name, rank in ranks.items() if rank is not None}
        return Outcome(found=2, gain=own[0].nats, ranks=known)

    return draw


def nearest(hidden: Hidden, found: tuple[Effect, ...]) -> Effect | None:
    """Return the effect that was meant; None where it was not found."""
    same = [one for one in found if one.kind == hidden.kind]
    for name, room in hidden.places.items():
        at = hidden.truth[name]
        same = [one for one in same if abs(float(one.parameters[name].value) - at) < room]
        same.sort(key=lambda one: abs(float(one.parameters[name].value) - at))
    return same[0] if same else None


def rank_of_coefficient(fit: NoiseFit, name: str, truth: float) -> float | None:
    """Return the confidence below the truth, given that it was detected; None where it was not."""
    found, inner = fit.coefficients[name], fit.fit
    index = inner.index(name)
    if index is None or not found.detected:
        return None
    spread_of = float(inner.all_free().relative_sd()[inner.model.numbers.index(inner.free[index])])
    if spread_of < NORMAL:
        return float(norm.cdf(np.log(truth / found.value) / spread_of))
    free = inner.free[index]

    def lost(value: float) -> float:
        model = inner.model.with_numbers([free], [value])
        held = inner.likelihood.maximise(model, held=inner.held | {free})
        return max(2 * (inner.loglik - held.loglik), 0.0)

    relative = min(float(inner.relative_sd()[index]), 1.0)
    root = np.sqrt(lost(truth) / (1 + 2 / 3 * relative**2))
    away = np.sign(truth - float(inner.values[index])) * root
    if name == "N":
        return float(norm.cdf(away))
    limit = 2 * Q_PENALTY if name == "Q" else DETECTED
    least = just_detected(inner, index, min(limit / lost(0.0), 1.0))
    return conditional_rank(away, 0.0, -np.sqrt(lost(least) / (1 + 2 / 3 * relative**2)))


def just_detected(fit: Fit, index: int, share: float) -> float:
    """Return the amplitude of which so much of the evidence against zero would be expected.

    Near zero evidence grows by the fourth power of an amplitude, far above by less than its square:
    the limit is farther from the estimate than the roots of their evidence are from each other.
    """
    free, best = fit.free[index], float(fit.values[index])

    def evidence(value: float) -> float:
        model = fit.model.with_numbers([free], [value])
        power = fit.likelihood.expected(model)
        ends = np.cumsum([len(part.power) for part in fit.likelihood.evidence])[:-1]
        parts = zip(fit.likelihood.evidence, np.split(power, ends), strict=True)
        exact = Likelihood([replace(part, power=own) for part, own in parts])
        none = exact.maximise(model.with_numbers([free], [0.0]), held=fit.held | {free})
        return exact.value(power) - none.loglik

    wanted = share * evidence(best)
    if share >= 1.0:
        return best
    return brentq(lambda value: evidence(value) - wanted, 1e-3 * best, best, rtol=1e-3)


def rank_of_number(name: str, found: Parameter, truth: float, row: float) -> float | None:
    """Return the rank of a parameter by its name: of what is read off 0.5 if its interval holds."""
    if name not in READ_OFF:
        return rank_of_parameter(found, truth, row if name in JUMPS else 0.0)
    if found.lower is None or found.upper is None:
        return None
    room = 1e-9 * abs(truth)
    return 0.0 if truth < found.lower - room else 1.0 if truth > found.upper + room else 0.5


def rank_of_border(found: Parameter, truth: float, rate: float, logliks: list[Array]) -> float:
    """Return the confidence below the border of louder noise, by the likelihood that told it."""
    told = np.array([found.lower, found.value, found.upper], np.float64) * rate
    for loglik in reversed(logliks):
        median, low, high = rows_of_loglik(loglik)
        if np.allclose(np.diff(told), [median - low, high - median]):
            below, rows = confidence_of_loglik(loglik)
            return float(np.interp(truth * rate - told[0] + low, rows, below))
    raise AssertionError("no border was looked for")


def rank_of_parameter(found: Parameter, truth: float, row: float = 0.0) -> float | None:
    """Return the confidence below the truth; None where no interval is given.

    `row` is the distance of samples, of the instant of a jump; 0 of any other number.
    """
    if found.lower is None or found.upper is None:
        return None
    value, lower, upper = float(found.value), float(found.lower), float(found.upper)
    if not upper > lower:
        return None
    if lower > 0 and abs(np.sqrt(lower * upper) / value - 1) < 1e-6:  # of a logarithm
        value, lower, upper, truth = (float(np.log(x)) for x in (value, lower, upper, truth))
    if upper - value < 1e-9 * (value - lower):  # not after it
        return 0.05 ** max((value - truth) / (value - lower), 0.0)
    width = upper - value if truth > value else value - lower
    distance = (truth - value) / max(width, 1e-300)
    if row:
        away = abs(distance)
        if width >= row:
            beyond = 0.5 * 0.05**away
        else:
            beyond = 0.5 - 0.475 * away if away < 1 else 0.025 / away
        return 1 - beyond if distance > 0 else beyond
    return float(norm.cdf(TWO_SIDED_95 * distance))


def fitted(samples: Array, rate: float) -> NoiseFit:
    """Do what a run does without a spectrum of its own: the history, the fit."""
    history = History(1)
    history.update(samples)
    return fit_noise(history.record(rate, ("gx",), (1.0,)), "gx")


def spread(rng: np.random.Generator, factor: float) -> float:
    """Draw a factor, evenly in its logarithm."""
    return float(factor ** rng.uniform(-1, 1))


DRAWS: dict[str, Draw] = {
    **{name: coefficients(*length) for name, length in COEFFICIENTS.items()},
    "Q": quantization,
    "R": ramp,
    **{study: effect(study) for study in STUDIES},
    "clock": clock,
    **{f"onset of {kind}": begun(kind) for kind in ONSETS},
}
"""Every study."""
