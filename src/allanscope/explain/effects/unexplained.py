"""What no name fits: it is measured, located and reported, never given a wrong name.

A tone that changes (a chirp, a modulated tone) is cut out of the spectrum so that the search can go
on beside it. At the end of the search the residual is looked at once more: bands of the whitened
spectrum, a slow drift that nothing explains, tails of the innovations.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.polynomial.legendre import legder, legval
from numpy.polynomial.polynomial import polymul
from numpy.typing import NDArray

from allanscope.explain.candidate import ALPHA, Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.variance_change import VarianceChange
from allanscope.explain.noise_level_period import noise_level_period
from allanscope.explain.presence import presence_of
from allanscope.explain.regression import exponential_ordinates, joint_fit
from allanscope.explain.residual import (
    Bands,
    band_scores,
    excess_kurtosis,
    excess_skewness,
    quartile_deviation,
    quiet_innovations,
    removes,
)
from allanscope.explain.stationarity import UNSTEADY, bartlett_z_of, reach_of
from allanscope.explain.view import View
from allanscope.noise.components import LineProfile
from allanscope.noise.grid import Ranges
from allanscope.noise.selection import calibrated_penalty
from allanscope.quantities import CHI_SQUARE_MEDIAN, TWO_SIDED_95, measured, periods

Array = NDArray[np.float64]

_BAND_Z = 5.0
"""Sigma from which a band does not fit: sixty bands of a clean record reach it once in 30 000."""
_EVEN = 2.5
"""Power of the noise on one side of a range over that on the other up to which both are its
floor."""
_NEIGHBOUR_Z = 3.0
"""Sigma from which a band beside it belongs to it."""
_NEXT = 1.15
"""Ratio of frequencies up to which two ranges are neighbours."""
_TAIL_Z = 6.0
"""Standard errors of skewness and kurtosis from which the distribution is not a Gaussian's."""
_SLIGHT_SKEWNESS, _SLIGHT_KURTOSIS = 0.05, 0.1
"""Up to which that changes nothing: the interval of N would be 2 % wider."""
_COARSE = 0.12
"""Share of the rounding in the power, at 0.75 of a step of noise, from which it is not Gaussian."""
_CORE = 0.9
"""Deviation of the core relative to that of all values from which the tails matter to N."""
_STRETCHES = 64
"""Stretches, each of nearly one level, within which tails are looked at where the level changes."""
_TURNS = 4
"""Most times that the ends of a range are found again without it."""
_WAVES, _REMNANT = 5.0, 0.1
"""Waves of a cut tone from an end of the record, and share of its gain, of what it may leave."""
_OF_A_DRIFT = 0.03
"""Share of the gain of a drift without a name up to which a change of the level is left of it."""
_GAP = 100
"""Ordinates between which two loud ones belong to one tone: the sidebands of what is modulated."""
_LEVEL = 0.05
"""Excess that a model may miss beside a tone: of many ordinates the error is smaller."""
_MOST = 0.4
"""Share of the spectrum beyond which what is cut out has no end."""
_LOWEST = 8
"""Ordinate below which a range begins at the lowest frequency of the record."""
_PIECES = 16
"""Parts of the spectrum whose medians are its level where the model misses it, each the widest that
a tone may be there."""
_LOUD = 40.0
"""Power of an ordinate over the model's that noise does not reach in any record."""
_OF_THE_MEDIAN = 1.06
"""Standard deviation of the median of chi-squares with one degree of freedom, times sqrt(n)."""
_CHANGES = "a tone {} Hz changes in frequency or amplitude"
DEGREE = 7
"""Of the polynomial that stands for a drift without a form: its ordinates lie below the eighth."""
RELAXATIONS = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Time constants beside that of the one exponential, relative to it."""
DRIFT_PENALTY = calibrated_penalty("drift")
"""Nats that the polynomial hardly gains on a clean record."""


@dataclass(frozen=True)
class Unexplained(EffectKind):
    """A residual without a name.

    Attributes
    ----------
    frequency_low, frequency_high : Estimate
        Where it sits.
    domain : str
        ``spectrum`` for a range that is cut out of the fit, ``level`` for a slow drift that is
        subtracted, ``distribution`` for values that are no Gaussian's.
    description : str
        What was seen, in a phrase.
    figures : mapping
        Numbers that it speaks of.
    """

    frequency_low: Estimate
    frequency_high: Estimate
    domain: Literal["spectrum", "level", "distribution"]
    description: str
    figures: Mapping[str, float] = field(default_factory=dict)

    kind = "unexplained"
    meaning = "a residual that no effect explains"
    as_cause = "an unexplained component"
    located_by = "frequency_low"
    is_named = False
    stage = 4

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return self.description

    @property
    def evidence(self) -> dict[str, Any]:
        """What else it knows of itself."""
        return {"domain": self.domain, **self.figures}

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest frequency in Hz."""
        return self.frequency_low.value, self.frequency_high.value

    @property
    def is_unnamed_drift(self) -> bool:
        """Whether it is a slow drift."""
        return self.domain == "level"

    @property
    def shows_in_distribution(self) -> bool:
        """Whether it shows in the distribution of the samples, and not in their spectrum."""
        return self.domain == "distribution"

    @property
    def is_misfit(self) -> bool:
        """Whether it is a range in which the power is not that of the model."""
        return self.domain == "spectrum" and "z" in self.figures

    @property
    def is_tone(self) -> bool:
        """Whether it is a tone that changes, or several."""
        return self.domain == "spectrum" and not self.is_misfit

    def is_resolved(self, view: View) -> bool:
        """Return whether its range has not been cut out of the fit already."""
        if self.domain != "spectrum":
            return True
        unit = view.grid.rate_hz / (2 * view.grid.n)
        low, high = (round(f / unit) for f in self.limits)
        return bool(view.spectrum.kept[max(0, low - 1) : max(1, high)].any())

    def refuses(self, view: View, known: Candidate, other: Candidate) -> str:
        """Refuse what a loud tone or a large drift leaves of itself in the level.

        Cutting frequencies out does not cut where the record begins and ends in the middle of a
        wave, and what describes a drift without a name describes it to some per cent of its gain.
        """
        distance_s = other.effect.from_end_s(view)
        if distance_s is None:
            return ""
        if self.is_unnamed_drift:
            return "left of a drift" if other.gain < _OF_A_DRIFT * known.gain else ""
        is_near = self.domain == "spectrum" and distance_s * self.frequency_low.value < _WAVES
        return "the end of a strong tone" if is_near and other.gain < _REMNANT * known.gain else ""

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Look at what is left in the spectrum, the slow drift and the distribution."""
        yield from _bands(view)
        drift = drift_left_over(view)
        if drift is not None:
            yield drift
        if not any(one.domain == "distribution" for _, one in _known(view)):
            yield from _piles(view) or _tails(view)


def _known(view: View) -> list[tuple[Candidate, Unexplained]]:
    """Return what has been accepted without a name."""
    return [(c, c.effect) for c in view.accepted if isinstance(c.effect, Unexplained)]


def _range(view: View, low: float, high: float) -> str:
    """Return where a range is: two frequencies, or the upper one where it begins at the lowest."""
    return f"below {high:.3g}" if _is_lowest(view, low) else f"between {_both(low, high)}"


def _is_lowest(view: View, low: float) -> bool:
    """Return whether a range that begins there begins at the lowest frequency of the record."""
    return low < _LOWEST * view.grid.rate_hz / (2 * view.grid.n)


def _both(low: float, high: float) -> str:
    """Return two frequencies in as many digits as their distance deserves, three at least.

    >>> _both(0.00093528, 3.9403), _both(49.97712, 49.99903)
    ('0.000935 and 3.94', '49.977 and 49.999')
    """
    digits = 3
    if high > low:
        digits = min(max(3, 1 + math.ceil(math.log10(high / (high - low)))), 9)
    return f"{low:.{digits}g} and {high:.{digits}g}"


def left_over(
    view: View,
    band: tuple[float, float],
    gain: float,
    words: str,
    log_alternatives: float = 0.0,
    parts: Ranges = (),
    **figures: float,
) -> Candidate:
    """Return an unexplained range of frequencies, which is cut out of the fit.

    It has no penalty: what it was searched for with was paid, or it is looked at once at the end.

    Parameters
    ----------
    log_alternatives : float
        Log of the number of alternatives that were looked at.
    parts : tuple of (float, float), optional
        Ranges within it that are cut out; by default all of it.
    """
    effect = _unexplained(view, band, "spectrum", words, **figures)
    cut = parts or ((effect.frequency_low.value, effect.frequency_high.value),)
    return Candidate(effect, gain, log_alternatives, is_paid=True, excluded=cut)


def _unexplained(
    view: View,
    band: tuple[float, float],
    domain: Literal["spectrum", "level", "distribution"],
    words: str,
    **figures: float,
) -> Unexplained:
    low, high = max(band[0], 0.0), min(band[1], view.grid.rate_hz / 2)
    low_hz, high_hz = Estimate(low, unit="Hz"), Estimate(high, unit="Hz")
    return Unexplained(low_hz, high_hz, domain, words, figures)


def tone_left_over(
    view: View, candidate: Candidate, f0: float, width: float = 0.0
) -> Candidate | None:
    """Return the range that a tone or band covers which is not what its name would say.

    None where it has no end: what covers most of the spectrum is no tone, but a model of the rest
    that does not fit, and with all of it cut out there would be nothing left to fit. What is loud
    against the spectrum around it is a tone all the same, and ends where that begins.
    """
    unit = view.grid.rate_hz / (2 * view.grid.n)
    reach = max(width, 8 * unit)
    low, high, cut = f0 - reach, f0 + reach, view
    for _ in range(_TURNS):
        # What is beside it is known only once it is out of the fit.
        before = (low, high)
        low, high = _extent(cut.squares / cut.spectrum.ordinates, low, high, unit)
        if (low, high) == before:
            break
        if high - low > _MOST * view.grid.rate_hz / 2:
            return _tone_above_its_surroundings(view, candidate, (f0 - reach, f0 + reach))
        cut = view.without_range(low, high)
    return band_left_over(view, candidate, (low, high))


def _tone_above_its_surroundings(
    view: View, candidate: Candidate, band: tuple[float, float]
) -> Candidate | None:
    """Return the range of a tone in a spectrum that the model misses; None where it has no end."""
    unit = view.grid.rate_hz / (2 * view.grid.n)
    u = view.squares / view.spectrum.ordinates
    u /= np.concatenate([np.full(len(p), np.median(p)) for p in np.array_split(u, _PIECES)])
    u *= CHI_SQUARE_MEDIAN
    low, high = _extent(u, *band, unit)
    inside = slice(max(0, round(low / unit) - 1), round(high / unit))
    if high - low > len(u) / _PIECES * unit or u[inside].mean() < _LOUD:
        return None
    return band_left_over(view, candidate, (low, high))


def band_left_over(view: View, candidate: Candidate, band: tuple[float, float]) -> Candidate:
    """Return a range that a tone or band covers which is not what its name would say."""
    words, searched = _CHANGES.format(_range(view, *band)), candidate.log_alternatives
    return left_over(view, band, candidate.gain, words, searched)


def lasting(view: View, process: Candidate) -> Candidate | None:
    """Return a process that removes its part of the residual and is there all along.

    One that comes and goes is a tone that sweeps, and has no name.
    """
    if not removes(view, process):
        return None
    if bartlett_z_of(view, process) <= UNSTEADY:
        return process
    _, high = reach_of(view, process)
    return tone_left_over(view, process, high / 2, high / 2)


def tone_without_name(
    view: View, profile: LineProfile, error: float, searched: Candidate
) -> Candidate:
    """Return what a range holds that is no line, with the size of its power.

    `error` is the relative one of the size. What changes may add as little as nothing to the power
    beside it, or take some away: then the size is a limit.
    """
    known = 2 * TWO_SIDED_95 * error < 1
    size = profile.sigma if known else profile.sigma * float(np.sqrt(1 + 2 * TWO_SIDED_95 * error))
    longest = 0.0 if _is_lowest(view, profile.low) else profile.low
    where = f"{_range(view, profile.low, profile.high)} Hz{periods(longest, profile.high)}"
    limit = "" if known else "below "
    words = f"power {where} changes in frequency or amplitude; its rms is {limit}"
    words += measured(size, unit=view.unit)
    words += _when(view, profile.low, profile.high)
    band = (profile.low, profile.high)
    return left_over(view, band, searched.gain, words, searched.log_alternatives)


def tones_left_over(view: View, lines: Sequence[tuple[Candidate, float]]) -> Candidate | None:
    """Return the range that lines at several frequencies cover which are one modulated tone."""
    found = [tone_left_over(view, line, frequency) for line, frequency in lines]
    # What is between a carrier and sidebands far from it is noise like any other.
    parts = tuple(cut for one in found if one is not None for cut in one.excluded)
    if not parts:
        return None
    low, high = min(p[0] for p in parts), max(p[1] for p in parts)
    gain = sum(line.gain for line, _ in lines)
    searched = sum(line.log_alternatives for line, _ in lines)
    words = _CHANGES.format(_range(view, low, high))
    return left_over(view, (low, high), gain, words, searched, parts)


def _extent(u: Array, low_hz: float, high_hz: float, unit: float) -> tuple[float, float]:
    """Grow a range until the spectrum beside it is level."""
    low, high = max(0, round(low_hz / unit - 0.5)), min(len(u), round(high_hz / unit - 0.5))
    width = max(8, (high - low) // 2)
    gap = max(_GAP, width)

    def is_level(below: bool) -> bool:
        sides = [
            u[max(0, low - size) : low] if below else u[high : high + size]
            for size in (width, 4 * width, 16 * width)
        ]
        loud = u[max(0, low - gap) : low] if below else u[high : high + gap]
        near, *far = sides
        # Farther away there may be others: the median does not see them, the mean would reach them.
        return (
            loud.max() < _LOUD
            and near.mean() < 1 + max(4 * np.sqrt(2 / len(near)), _LEVEL)
            and all(
                np.median(side)
                < CHI_SQUARE_MEDIAN + max(4 * _OF_THE_MEDIAN / np.sqrt(len(side)), _LEVEL)
                for side in far
            )
        )

    while low > 0 and not is_level(below=True):
        low = max(0, low - width)
    while high < len(u) and not is_level(below=False):
        high = min(len(u), high + width)
    return (low + 0.5) * unit, (high + 0.5) * unit


def united(view: View, candidate: Candidate) -> tuple[View, Candidate]:
    """Let a range swallow those it touches: the sidebands of one tone are named once.

    Returns the view without the ranges that were swallowed, and the candidate for all of them. It
    ends where the union would leave nothing to fit.
    """
    room = _GAP * view.grid.rate_hz / (2 * view.grid.n)
    while (
        isinstance(own := candidate.effect, Unexplained)
        and own.domain == "spectrum"
        and (touched := _touched(view, *own.limits, room)) is not None
    ):
        near, other = touched
        low = min(other.frequency_low.value, own.frequency_low.value)
        high = max(other.frequency_high.value, own.frequency_high.value)
        rest = view.without(near)
        gain = near.gain + candidate.gain
        searched = near.log_alternatives + candidate.log_alternatives
        words = _CHANGES.format(_range(view, low, high))
        union = left_over(rest, (low, high), gain, words, searched)
        if rest.leaves_too_little(union):
            break
        view, candidate = rest, union
    return view, candidate


def beside(view: View, frequency: float) -> bool:
    """Return whether a tone lies so near to one that has no name that it will be part of it."""
    unit = view.grid.rate_hz / (2 * view.grid.n)
    return _touched(view, frequency - unit, frequency + unit, _GAP * unit) is not None


def _touched(
    view: View, low: float, high: float, room: float
) -> tuple[Candidate, Unexplained] | None:
    """Return what is cut out of the view and touches a range; drifts are not cut out.

    The narrower of the two tells how near is near: what is united grows, and if the wider did,
    every union would reach for the next stranger.
    """
    for near, one in _known(view):
        first, last = one.limits
        gap = max(room, min(high - low, last - first))
        if one.domain == "spectrum" and first < high + gap and low < last + gap:
            return near, one
    return None


def _bands(view: View) -> Iterable[Candidate]:
    """Report runs of bands that the model misses, and keep them from bending B and K."""
    if view.has("quantization"):
        return
    bands = band_scores(view)
    known = [one.limits for _, one in _known(view) if one.domain != "distribution"]
    inside = _run(bands, int(np.argmax(np.abs(bands.z))))
    louder = _run(bands, int(np.argmax(bands.z)))
    if bands.z[inside].max() < 0 and _lifts_the_fit(bands, louder, view.grid.n - 1):
        inside = louder
    z = float(max(bands.z[inside], key=abs))
    band = float(bands.low[inside][0]), float(bands.high[inside][-1])
    if abs(z) < _BAND_Z or any(a < band[1] and band[0] < b for a, b in known):
        return
    more = float(np.average(bands.ratio[inside] - 1, weights=bands.count[inside]))
    yield _misfit(view, band, more, z, z**2 / 2, float(np.log(len(bands.z))))


def _run(bands: Bands, worst: int) -> slice:
    """Return the bands around one that the model misses to the same side."""
    off = bands.z * np.sign(bands.z[worst]) > _NEIGHBOUR_Z
    low = high = worst
    while low > 0 and off[low - 1]:
        low -= 1
    while high < len(off) - 1 and off[high + 1]:
        high += 1
    return slice(low, high + 1)


def _lifts_the_fit(bands: Bands, louder: slice, ordinates: int) -> bool:
    """Return whether power in a range is why the rest has less than the model: it is on no floor.

    Not where the noise is louder from the lowest frequencies on, or lower on one side of the range
    than on the other: then a filter takes the rest away. Half of all ordinates must be left.
    """
    is_clear = bands.z[louder].max() >= _BAND_Z and louder.start > 0
    count = bands.count.copy()
    count[louder] = 0.0
    if not is_clear or bands.z[: louder.start].min() > -_NEIGHBOUR_Z or count.sum() < ordinates / 2:
        return False
    sides = slice(0, louder.start), slice(louder.stop, None)
    floors = [np.average(bands.ratio[p], weights=count[p]) for p in sides if count[p].any()]
    return bool(max(floors) < _EVEN * min(floors))


def _misfit(
    view: View, band: tuple[float, float], more: float, z: float, gain: float, searched: float
) -> Candidate:
    side = "more" if more > 0 else "less"
    percent = 100 * abs(more)
    words = (
        f"{percent:{'.2g' if percent < 99.5 else '.0f'}} % {side} power than the model between "
        f"{band[0]:.3g} and {band[1]:.3g} Hz (z = {z:.1f})"
    )
    frequency = view.grid.frequency
    inside = (frequency >= band[0]) & (frequency <= band[1]) & view.spectrum.kept
    power = float((view.squares - view.spectrum.ordinates)[inside].sum()) / view.grid.n
    if power > 0:
        words += f"; its rms is {measured(float(np.sqrt(power)), unit=view.unit)}"
        words += _when(view, *band)
    return left_over(view, band, gain, words, searched, z=z, excess=more)


def _when(view: View, low: float, high: float) -> str:
    """Return when the power of a range is there, empty where it is all along."""
    there = presence_of(view, low, high)
    return f", {there.words}" if there else ""


def with_misfits_joined(view: View) -> View:
    """Return the view with neighbouring ranges of too much, or too little, power as one.

    Ranges were found one after the other, each without those before it.
    """
    misfits = [(c, one, one.figures["z"]) for c, one in _known(view) if one.is_misfit]
    misfits.sort(key=lambda m: m[1].limits)
    groups: list[list[tuple[Candidate, Unexplained, float]]] = []
    for misfit in misfits:
        if groups:
            _, last, z = groups[-1][-1]
            is_next = misfit[1].limits[0] < _NEXT * last.limits[1]
            if is_next and z * misfit[2] > 0:
                groups[-1].append(misfit)
                continue
        groups.append([misfit])
    for group in groups:
        if len(group) < 2:
            continue
        ranges = [one.limits for _, one, _ in group]
        band = min(low for low, _ in ranges), max(high for _, high in ranges)
        widths = [high - low for low, high in ranges]
        more = float(np.average([one.figures["excess"] for _, one, _ in group], weights=widths))
        z = max((z for _, _, z in group), key=abs)
        gain = sum(c.gain for c, _, _ in group)
        view = view.without(*(c for c, _, _ in group))
        view = view.accept(_misfit(view, band, more, z, gain, group[0][0].log_alternatives))
    return view


@lru_cache(maxsize=4)
def _polynomials(n: int, m: int) -> Array:
    """First m ordinates of the Legendre polynomials from degree 1 on, the same for every axis.

    Summed twice by parts, the k-th ordinate of f at n points is what f does at the ends, over
    (2 sin(theta / 2))^2 with theta = pi k / n, less that of its second differences over the same:
    of a polynomial there is an end to it, of an even one the odd ordinates are 0, and the other way
    round. Differences at an end are sums of derivatives, 2 sinh(h D / 2) for points h apart.
    """
    step, half = 2 / (n - 1), np.pi * np.arange(1, m + 1) / (2 * n)
    found = np.zeros((DEGREE, m))
    powers = range(DEGREE + 1)
    first = np.array([q % 2 / (math.factorial(q) * 2.0 ** (q - 1)) for q in powers])
    second = polymul(first, first)
    for degree in range(1, DEGREE + 1):
        legendre = [0.0] * degree + [1.0]
        derivatives = [step**q * legval(1 + step / 2, legder(legendre, q)) for q in powers]
        at_end, difference = [], first
        for _ in range((degree + 1) // 2):
            at_end.append(float(difference @ derivatives))
            difference = polymul(difference, second)[: DEGREE + 1]
        own = half[(degree - 1) % 2 :: 2]
        turn, total = 1 / (2 * np.sin(own)) ** 2, np.zeros(len(own))
        for jump in reversed(at_end):
            total = turn * (jump - total)
        found[degree - 1, (degree - 1) % 2 :: 2] = (-1) ** degree * np.cos(own) * total
    return np.asarray(found * np.sqrt(8 / n))


def drift_left_over(view: View) -> Candidate | None:
    """Return what a free polynomial explains: a drift that has no name.

    Any drift of up to two waves in the record is a polynomial of degree 7 to a per cent.
    """
    m = view.grid.low
    if view.drifts or not view.spectrum.kept[:DEGREE].all():
        return None
    fit = joint_fit(view, _polynomials(view.grid.n, m))
    if fit.gain < DRIFT_PENALTY:
        return None
    x = np.linspace(-1, 1, view.grid.n)
    drift = legval(x, [0.0, *fit.amplitude])
    words = "a drift slower than {:.0f} s that is not exponential, linear or thermal"
    return _drift(view, drift, fit.gain, words)


def relaxation_left_over(view: View, tau: float) -> Candidate:
    """Return what several exponentials explain: a relaxation that is not one of them.

    Logarithms, powers and stretched exponentials of the time since power-on are mixtures of
    relaxations, fast ones first; a polynomial needs a high degree for their beginning.
    """
    times = [tau * factor for factor in RELAXATIONS]
    columns = np.array([exponential_ordinates(view.grid, t, view.grid.low) for t in times])
    fit = joint_fit(view, columns)
    t = np.arange(view.grid.n) / view.grid.rate_hz
    drift = np.zeros(view.grid.n)
    for size, time in zip(fit.amplitude, times, strict=True):
        drift += size * np.exp(-t / time)
    words = "the level relaxes from the start of the record, but not as one exponential"
    return _drift(view, drift, fit.gain, words)


def slow_drift(view: View, drift: Array, gain: float, high: float, words: str) -> Candidate:
    """Return a drift below a frequency that has no name and is subtracted.

    The noise that it took along is missing there: the fit must not count it as low.
    """
    effect = _unexplained(view, (0.0, high), "level", words)
    looked_at = DRIFT_PENALTY + float(np.log(ALPHA))
    return Candidate(effect, gain, looked_at, signal=drift, excluded=((0.0, high),))


def _drift(view: View, drift: Array, gain: float, words: str) -> Candidate:
    high = (DEGREE + 0.5) * view.grid.rate_hz / (2 * view.grid.n)
    return slow_drift(view, drift - drift.mean(), gain, high, words.format(1 / high))


def _piles(view: View) -> list[Candidate]:
    """Report values within the range at which samples collect, and which are no dead zone."""
    inside = [
        crowded for crowded in view.crowded_codes if crowded.side == 0 and not view.has("dead_zone")
    ]
    if view.series.stride > 1 or view.has("quantization") or not inside:
        return []
    most = max(inside, key=lambda crowded: crowded.share)
    words = (
        f"{100 * most.share:.2g} % of the samples are {measured(most.value, unit=view.unit)}, "
        "far more than at the values beside it: a narrow dead zone or a replaced code"
    )
    return [_distribution(view, math.inf, words, values=len(inside))]


def _distribution(view: View, gain: float, words: str, **figures: float) -> Candidate:
    """Return what is wrong with the distribution of the samples, at all frequencies."""
    band = (0.0, view.grid.rate_hz / 2)
    return Candidate(_unexplained(view, band, "distribution", words, **figures), gain)


def _tails(view: View) -> list[Candidate]:
    # The rounding's part of the power: what it adds is flat, with an excess kurtosis of -1.2.
    rounding = view.floor / float(np.median(view.spectrum.ordinates))
    known = [c.effect for c in view.accepted if c.effect.is_not_gaussian]
    levels = [effect for effect in known if isinstance(effect, VarianceChange)]
    if rounding > _COARSE or len(levels) < len(known):
        return []
    kurtosis, error = excess_kurtosis(view)
    if levels:
        return _tails_beside(levels[0], view) if kurtosis > 0 else []
    skewness, uncertain = excess_skewness(view)
    is_skewed = abs(skewness) > max(_TAIL_Z * uncertain, _SLIGHT_SKEWNESS)
    if is_skewed and abs(skewness) / uncertain > abs(kurtosis) / error:
        side = "upper" if skewness < 0 else "lower"
        words = f"a skewed distribution, cut short on the {side} side (skewness {skewness:.2g})"
        gain = (skewness / uncertain) ** 2 / 2
        return [_distribution(view, gain, words, skewness=skewness)]
    if abs(kurtosis + 1.2 * rounding**2) < _TAIL_Z * error:
        return []
    tails = "heavier" if kurtosis > 0 else "lighter"
    words = f"{tails} tails than a Gaussian (excess kurtosis {kurtosis:.2g})"
    gain = (kurtosis / error) ** 2 / 2
    figures = {"excess_kurtosis": kurtosis}
    white, period_s = quiet_innovations(view), None
    if kurtosis > 0 and not any(c.effect.spans for c in view.accepted):
        period_s = noise_level_period(view.innovations, view.grid.rate_hz)
    if period_s is not None:
        words += f": the noise is louder every {period_s:.4g} s"
        figures["period_s"] = period_s
    elif abs(kurtosis) < _SLIGHT_KURTOSIS:
        return []
    elif kurtosis > 0:
        # Of a Gaussian with the same quartiles, relative to that of all values.
        figures["core_ratio"] = core = quartile_deviation(white) / float(np.std(white))
        if core < _CORE:
            words += f": its core has {core:.2g} times the noise"
    return [_distribution(view, gain, words, **figures)]


def _tails_beside(level: VarianceChange, view: View) -> list[Candidate]:
    """Return tails within stretches, beyond what two levels of noise in each of them would have."""
    kurtosis, error = excess_kurtosis(view, _STRETCHES)
    squared = level.ratio.value**2
    beyond = kurtosis - 0.75 * (squared - 1) ** 2 / squared
    if beyond < max(_TAIL_Z * error, _SLIGHT_KURTOSIS):
        return []
    words = f"heavier tails than a Gaussian (excess kurtosis {kurtosis:.2g}) at each noise level"
    gain = (kurtosis / error) ** 2 / 2
    return [_distribution(view, gain, words, excess_kurtosis=kurtosis)]
