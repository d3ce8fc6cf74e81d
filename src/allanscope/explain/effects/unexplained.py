"""What no name fits: it is measured, located and reported, never given a wrong name.

A tone that changes (a chirp, a modulated tone) is cut out of the spectrum so that the search can go
on beside it. At the end of the search the residual is looked at once more: bands of the whitened
spectrum, a slow drift that nothing explains, tails of the innovations.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import eval_legendre

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Parameter
from allanscope.explain.effects.base import ALPHA, EffectKind
from allanscope.explain.regression import exponential_ordinates, joint_fit, ordinates_of
from allanscope.explain.residual import band_scores, excess_kurtosis, excess_skewness
from allanscope.explain.series import CHI_SQUARE_MEDIAN
from allanscope.explain.view import View
from allanscope.noise.grid import Ranges

Array = NDArray[np.float64]

_BAND_Z = 5.0
_NEIGHBOUR_Z = 3.0
_TAIL_Z = 6.0
_COARSE = 0.12
"""Share of the rounding in the power, at 0.75 of a step of noise, from which it is not Gaussian."""
_HIDDEN_BY = (
    *("variance_change", "quantization", "random_telegraph", "repeated_samples", "saturation"),
)
"""With these the innovations are no Gaussian's in any case."""
_TURNS = 4
_WAVES = 5.0
_REMNANT = 0.1
"""Waves of a cut tone from an end of the record, and share of its gain, of what it may leave."""
_CHANGES_OF_LEVEL, _OF_A_DRIFT = ("warm_up", "step", "excursion"), 0.03
_GAP = 100
"""Ordinates between which two loud ones belong to one tone: the sidebands of what is modulated."""
_MOST = 0.5
_LOUD = 40.0
"""Power of an ordinate over the model's that noise does not reach in any record."""
_OF_THE_MEDIAN = 1.06
"""Standard deviation of the median of chi-squares with one degree of freedom, times sqrt(n)."""
_CHANGES = "a tone between {:.5g} and {:.5g} Hz changes in frequency or amplitude"
DEGREE = 7
RELAXATIONS = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Time constants beside that of the one exponential, relative to it."""
DRIFT_PRICE = 20.0
"""Nats that the polynomial gains on one clean record in 1000 or fewer (by simulation)."""


class Unexplained(EffectKind):
    """A residual without a name."""

    kind = "unexplained"
    meaning = "left over, and no name fits"
    located_by = "frequency_low"
    stage = 4

    def propose(self, view: View) -> Iterable[Candidate]:
        """Look at what is left in the spectrum, the slow drift and the distribution."""
        yield from _bands(view)
        drift = drift_left_over(view)
        if drift is not None:
            yield drift
        if not any(c.shape == (0.0,) for c in view.accepted if c.kind == self.kind):
            yield from _piles(view) or _tails(view)


def left_over(
    view: View,
    band: tuple[float, float],
    gain: float,
    share: float,
    words: str,
    log_alternatives: float = 0.0,
    parts: Ranges = (),
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
    top = view.grid.rate_hz / 2
    low, high = max(band[0], 0.0), min(band[1], top)
    return Candidate(
        kind="unexplained",
        parameters={
            "frequency_low": Parameter(low, unit="Hz"),
            "frequency_high": Parameter(high, unit="Hz"),
            "share": Parameter(share),
        },
        gain=gain,
        price=0.0,
        excluded=parts or ((low, high),),
        shape=(low, high),
        words=words,
        log_alternatives=log_alternatives,
    )


def tone_left_over(view: View, candidate: Candidate) -> Candidate | None:
    """Return the range that a tone or band covers which is not what its name would say.

    None where it has no end: what covers most of the spectrum is no tone, but a model of the rest
    that does not fit, and with all of it cut out there would be nothing left to fit.
    """
    f0 = candidate.shape[0]
    unit = view.grid.rate_hz / (2 * view.grid.n)
    reach = max(candidate.shape[1] if candidate.kind == "narrowband" else 0.0, 8 * unit)
    low, high, cut = f0 - reach, f0 + reach, view
    for _ in range(_TURNS):
        # What is beside it is known only once it is out of the fit.
        before = (low, high)
        low, high = _extent(cut.squares / cut.spectrum.ordinates, low, high, unit)
        if (low, high) == before:
            break
        if high - low > _MOST * view.grid.rate_hz / 2:
            return None
        cut = view.without_range(low, high)
    inside = view.squares[max(0, int(low / unit) - 1) : int(high / unit) + 1]
    share = float(inside.sum() / view.squares.sum())
    words, searched = _CHANGES.format(low, high), candidate.log_looked_at(ALPHA)
    return left_over(view, (low, high), candidate.gain, share, words, searched)


def tones_left_over(view: View, lines: tuple[Candidate, ...]) -> Candidate | None:
    """Return the range that several lines cover which are one modulated tone."""
    ranges = [found for line in lines if (found := tone_left_over(view, line)) is not None]
    if not ranges:
        return None
    low, high = min(r.shape[0] for r in ranges), max(r.shape[1] for r in ranges)
    share = sum(r.number("share") for r in ranges)
    gain = sum(line.gain for line in lines)
    # What is between a carrier and sidebands far from it is noise like any other.
    parts = tuple((r.shape[0], r.shape[1]) for r in ranges)
    searched = sum(line.log_looked_at(ALPHA) for line in lines)
    words = _CHANGES.format(low, high)
    return left_over(view, (low, high), gain, share, words, searched, parts)


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
            and near.mean() < 1 + 4 * np.sqrt(2 / len(near))
            and all(
                np.median(side) < CHI_SQUARE_MEDIAN + 4 * _OF_THE_MEDIAN / np.sqrt(len(side))
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

    Returns the view without the ranges that were swallowed, and the candidate for all of them.
    """
    room = _GAP * view.grid.rate_hz / (2 * view.grid.n)
    while (near := _touched(view, candidate, room)) is not None:
        low = min(near.shape[0], candidate.shape[0])
        high = max(near.shape[1], candidate.shape[1])
        share = near.number("share") + candidate.number("share")
        view = view.without(near)
        words = _CHANGES.format(low, high)
        gain, searched = (
            near.gain + candidate.gain,
            near.log_looked_at(ALPHA) + candidate.log_looked_at(ALPHA),
        )
        candidate = left_over(view, (low, high), gain, share, words, searched)
    return view, candidate


def beside(view: View, tone: Candidate) -> bool:
    """Tell whether a tone lies so near to one that has no name that it will be part of it."""
    unit = view.grid.rate_hz / (2 * view.grid.n)
    near = left_over(view, (tone.shape[0] - unit, tone.shape[0] + unit), 0.0, 0.0, "")
    return _touched(view, near, _GAP * unit) is not None


def covered(view: View, candidate: Candidate) -> bool:
    """Tell whether a range without a name has been cut out of the fit already."""
    if not candidate.is_range or candidate.signal is not None:
        return False
    unit = view.grid.rate_hz / (2 * view.grid.n)
    low, high = (round(f / unit) for f in candidate.shape)
    return not view.spectrum.kept[max(0, low - 1) : max(1, high)].any()


def is_remnant(view: View, candidate: Candidate) -> bool:
    """Tell whether a change of the level is what a loud tone or a large drift leaves of itself.

    Cutting frequencies out does not cut where the record begins and ends in the middle of a wave,
    and what describes a drift without a name describes it to some per cent of its gain.
    """
    drifts = [c for c in view.accepted if c.is_drift]
    if candidate.kind in _CHANGES_OF_LEVEL and any(
        candidate.gain < _OF_A_DRIFT * c.gain for c in drifts
    ):
        return True
    if candidate.kind == "warm_up":
        distance_s = candidate.shape[0]
    elif candidate.kind in ("step", "excursion"):
        ends = min(candidate.shape[0], view.grid.n - candidate.shape[-1])
        distance_s = ends / view.grid.rate_hz
    else:
        return False
    return any(
        distance_s * c.shape[0] < _WAVES and candidate.gain < _REMNANT * c.gain
        for c in view.accepted
        if c.is_range and c.shape[0] > 0
    )


def _touched(view: View, candidate: Candidate, room: float) -> Candidate | None:
    """Return a range of the view that the candidate touches; none where either is a drift.

    The narrower of the two tells how near is near: what is united grows, and if the wider did,
    every union would reach for the next stranger.
    """
    if not candidate.is_range or candidate.signal is not None:
        return None
    low, high = candidate.shape
    for near in (c for c in view.accepted if c.is_range and c.signal is None):
        gap = max(room, min(high - low, near.shape[1] - near.shape[0]))
        if near.shape[0] < high + gap and low < near.shape[1] + gap:
            return near
    return None


def _bands(view: View) -> Iterable[Candidate]:
    """Report runs of bands that the model misses, and keep them from bending B and K."""
    if view.has("quantization"):
        return
    bands = band_scores(view)
    known = [c.shape for c in view.accepted if c.is_range]
    worst = int(np.argmax(np.abs(bands.z)))
    z = float(bands.z[worst])
    low = high = worst
    while low > 0 and bands.z[low - 1] * np.sign(z) > _NEIGHBOUR_Z:
        low -= 1
    while high < len(bands.z) - 1 and bands.z[high + 1] * np.sign(z) > _NEIGHBOUR_Z:
        high += 1
    first, last = float(bands.low[low]), float(bands.high[high])
    if abs(z) < _BAND_Z or any(a < last and first < b for a, b in known):
        return
    share = float(np.average(bands.ratio[low : high + 1] - 1, weights=bands.count[low : high + 1]))
    side = "more" if share > 0 else "less"
    yield left_over(
        view, (first, last), z**2 / 2, share,
        f"{100 * abs(share):.2g} % {side} power than the model between {first:.3g} and "
        f"{last:.3g} Hz (z = {z:.1f})",
        float(np.log(len(bands.z))),
    )  # fmt: skip


@lru_cache(maxsize=4)
def _polynomials(n: int, m: int) -> Array:
    """First m ordinates of the Legendre polynomials from degree 1 on, the same for every axis."""
    x = np.linspace(-1, 1, n)
    return np.array([ordinates_of(eval_legendre(k, x))[:m] for k in range(1, DEGREE + 1)])


def drift_left_over(view: View) -> Candidate | None:
    """Return what a free polynomial explains: a drift that has no name.

    Any drift of up to two waves in the record is a polynomial of degree 7 to a per cent.
    """
    m = view.grid.low
    if view.drifts or not view.spectrum.kept[:DEGREE].all():
        return None
    fit = joint_fit(view, _polynomials(view.grid.n, m))
    if fit.gain < DRIFT_PRICE:
        return None
    x = np.linspace(-1, 1, view.grid.n)
    drift = np.polynomial.legendre.legval(x, [0.0, *fit.amplitude])
    words = "a drift slower than {:.0f} s is neither exponential nor straight nor thermal"
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


def _drift(view: View, drift: Array, gain: float, words: str) -> Candidate:
    high = (DEGREE + 0.5) * view.grid.rate_hz / (2 * view.grid.n)
    share = float(np.var(drift) / np.var(view.data))
    found = left_over(view, (0.0, high), gain, share, words.format(1 / high))
    # The noise that the drift took along is missing there: the fit must not count it as low.
    return replace(found, signal=drift - drift.mean(), price=DRIFT_PRICE, log_alternatives=None)


def _piles(view: View) -> list[Candidate]:
    """Report values within the range at which samples pile up: a dead zone."""
    inside = [pile for pile in view.piles if pile.side == 0]
    if view.series.stride > 1 or view.has("quantization") or not inside:
        return []
    most = max(inside, key=lambda pile: pile.share)
    words = (
        f"{100 * most.share:.2g} % of the samples are {most.value:.4g} {view.unit}, far more than "
        "of the values beside it: a dead zone, or a value that stands for another"
    )
    return [_distribution(view, most.share, math.inf, words, {"values": len(inside)})]


def _distribution(
    view: View, share: float, gain: float, words: str, evidence: dict[str, float]
) -> Candidate:
    """Return what is wrong with the distribution of the samples, at all frequencies."""
    return Candidate(
        kind="unexplained",
        parameters={
            "frequency_low": Parameter(0.0, unit="Hz"),
            "frequency_high": Parameter(view.grid.rate_hz / 2, unit="Hz"),
            "share": Parameter(share),
        },
        gain=gain,
        price=float(np.log(1 / ALPHA)),
        shape=(0.0,),
        words=words,
        evidence=evidence,
    )


def _tails(view: View) -> list[Candidate]:
    kurtosis, error = excess_kurtosis(view)
    # The rounding's part of the power: what it adds is flat, with an excess kurtosis of -1.2.
    rounding = view.floor / float(np.median(view.spectrum.ordinates))
    hidden = rounding > _COARSE or any(view.has(kind) for kind in _HIDDEN_BY)
    if hidden:
        return []
    skewness, uncertain = excess_skewness(view)
    if abs(skewness) > _TAIL_Z * uncertain and abs(skewness) / uncertain > abs(kurtosis) / error:
        side = "upper" if skewness < 0 else "lower"
        words = f"the samples are lopsided, cut short on the {side} side (skewness {skewness:.2g})"
        gain = (skewness / uncertain) ** 2 / 2
        return [_distribution(view, abs(skewness) / 2, gain, words, {"skewness": skewness})]
    if abs(kurtosis + 1.2 * rounding**2) < _TAIL_Z * error:
        return []
    tails = "heavier" if kurtosis > 0 else "lighter"
    words = f"the samples have {tails} tails than a Gaussian (excess kurtosis {kurtosis:.2g})"
    share = abs(kurtosis) / (3 + kurtosis)
    gain = (kurtosis / error) ** 2 / 2
    return [_distribution(view, share, gain, words, {"excess_kurtosis": kurtosis})]
