r"""Another axis leaks in: misalignment, g-sensitivity, a shared supply.

y = c x + rest holds at every frequency and without lag, which a common vibration (one frequency) or
a common temperature (only slow) does not: the slopes found in separate frequency bands must agree.
So must those of stretches in which the source is quiet and loud: what shakes a board now and then
moves all axes at once, and is no leak. Two axes that sense one source through a structure, as those
on a board with a fan, agree in nothing but that it is there: the structure turns the phase, so
their cross-spectrum has a quadrature part, and a leak has none. What is beside a line of either
axis is left out: the skirts of a motor's lines are alike on all axes that it shakes. A tilt is
slow, so slow bands are looked at too; there what the measured temperature explains is taken out of
both axes first, and what is known by its slow part alone has the temperature as an equivalent.
Which axis is the source cannot be seen in white noise of equal colour; the direction is taken in
which source and rest together are more probable,

.. math:: L(x) + L(y - c x) \quad \text{against} \quad L(y) + L(x - c' y).

Where neither is, both axes list the coupling, but only one is cleaned of it: two axes that are each
cleaned of the other would both lack what they share.

Next to a shock all else is small. One that was taken out of this axis is out of the source as well;
of one that the source has alone the likelihood tells whether it came along.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft
from scipy.special import chdtrc, chdtri

from allanscope.explain.candidate import ALPHA, Candidate, HeldOut
from allanscope.explain.effect import Estimate, Parameter
from allanscope.explain.effects import EffectKind
from allanscope.explain.heldout import interleaved_signal
from allanscope.explain.series import LOUD, Source, in_time, multiple_of
from allanscope.explain.view import View
from allanscope.noise.grid import Grid

Array = NDArray[np.float64]

_SLOW_HZ = 0.1
"""Below, a common temperature correlates all axes."""
_FIRST = 8
"""First ordinate: within four waves a record, any two drifts are alike."""
_BANDS = 10
"""Bands, equally wide in log f, in each of which the ratio of two axes must be the same."""
_IN_QUADRATURE, _TURNED_P = 0.1, 1e-4
"""Part of the gain that the quadrature may have, as filters that differ turn the phase a little,
and the chance of what is more than none."""
_STRETCHES = 24
"""Stretches of the record, of which half are those in which the source is quiet."""
_OF_THE_LOUD, _APART = 0.5, 4.0
"""Ratio of the slope in these to that in the others below which it is another one, where it is so
many standard errors away from it."""
_OF_THE_TAPER = 35 / 18
"""Variance of a sum over tapered bins over that of as many independent ones (Hann)."""
_AMBIGUOUS = 3.0
"""Nats below which the direction cannot be told."""
_UNEQUAL = 0.01
"""Share of the gain that tells nothing of it: a slope is not the same everywhere to any digit."""
_FEWEST, _WIDTH, _ROUNDS = 16, 0.3, 3
"""Ordinates at the least, and share of its frequency, in a band with a level of its own; and times
that the slope is found again beside the levels."""
_SAME_VALUE = 1e-6
"""Of its scatter, by which the value that a signal ends with may differ from itself by rounding."""
_GONE, _THERE = 4.0, 10.0
"""Standard errors of its power above the noise up to which nothing is left of a line, and from
which it is there."""


@dataclass(frozen=True)
class CrossCoupling(EffectKind):
    """One axis leaks into another."""

    source: Parameter
    slope: Estimate
    direction_nats: float
    removed: bool

    kind = "cross_coupling"
    meaning = "another axis couples in, equally at all frequencies"
    phrase = "cross-coupling from {source}, {slope}"
    as_cause = "cross-coupling from {source}"
    is_coupling = True
    sized_by = "slope"
    located_by = "source"
    needs = frozenset({"axes"})
    confused_with: ClassVar[Mapping[str, str]] = {
        "sinusoid": "a common vibration correlates two axes at its own frequency only",
        "temperature": "a common temperature correlates only what is slow",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        leak = f"{self.source.value} couples in with {self.slope.text}"
        if not self.is_open:
            return leak
        leak += "; the direction is not determined by this recording"
        return leak if self.removed else f"{leak}, and it is removed from {self.source.value} only"

    @property
    def is_open(self) -> bool:
        """Whether the source may be this axis and not the other."""
        return self.direction_nats < _AMBIGUOUS

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether another coupling is the same hypothesis."""
        del grid
        return self.source == other.source

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Regress on every other axis."""
        taken = {c.effect.source.value for c in view.accepted if isinstance(c.effect, cls)}
        free = [a for a in view.series.axes if a != view.axis and a not in taken]
        own = _Own.of(view)
        return [found for a in free if (found := _candidate(view, a, own)) is not None]

    def refine(self, view: View) -> Candidate | None:
        """Estimate the slope again."""
        return _candidate(view, str(self.source.value), _Own.of(view))

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Follow the other axis from there on with the slope that is known."""
        if candidate.signal is None:
            return candidate
        column = view.series.column(str(self.source.value))
        known, follows = candidate.signal, self.slope.value * view.series.values[:, column]
        away = np.abs(known - known[-1]) > _SAME_VALUE * known.std()
        size = int(np.flatnonzero(away)[-1]) + 2 if away.any() else 0
        level = np.median((follows - known)[:size]) if size else follows.mean()
        signal = np.append(known[:size], follows[size:] - level)
        return replace(candidate, signal=signal)

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut:
        """Judge the slope by interleaved blocks; quarters must agree."""
        name = str(self.source.value)
        found = _followed(view, name, _Own.of(view))
        source = view.sources(name)[0] if found is None else found.source
        return interleaved_signal(view, source.rows[np.newaxis], candidate.gain)


@dataclass(frozen=True, eq=False)
class _Own:
    """An axis as it is regressed on others.

    Attributes
    ----------
    ordinates : ndarray, shape (n - 1,)
        Without the temperature.
    weight : ndarray, shape (n - 1,)
        What each counts: the inverse of the noise; nothing where the axis has a line.
    """

    ordinates: Array
    weight: Array

    @classmethod
    def of(cls, view: View) -> Self:
        known, noise = view.series.source(view.axis, view.shocks_taken), view.spectrum.ordinates
        loud = known.loud | known.lines | (view.squares > LOUD * noise)
        weight = (view.spectrum.kept & ~loud) / noise
        weight[:_FIRST] = 0.0
        return cls(_without_temperature(view, view.ordinates), weight)


@dataclass(frozen=True, eq=False)
class _Followed:
    """The regression of an axis on another one.

    Attributes
    ----------
    source : Source
        The other axis, without what does not belong to what this one has of it.
    ordinates, weight : ndarray, shape (n - 1,)
        Its ordinates without the temperature, and what each counts.
    slope, normal : float
        Likeliest slope, and the inverse of its variance.
    """

    source: Source
    ordinates: Array
    weight: Array
    slope: float
    normal: float

    @property
    def gain(self) -> float:
        """Log-likelihood that the slope gains."""
        return self.slope**2 * self.normal / 2


def _followed(view: View, name: str, own: _Own) -> _Followed | None:
    """Regress an axis on a source. Of what may be out of that, as the data are likelier."""
    found = (_regressed(view, source, own) for source in view.sources(name))
    return max(filter(None, found), key=lambda one: one.gain, default=None)


def _regressed(view: View, source: Source, own: _Own) -> _Followed | None:
    e = _without_temperature(view, source.ordinates)
    weight = np.where(source.loud | source.lines, 0.0, own.weight)
    weighted = e * weight
    normal = float(weighted @ e)
    if normal <= 0:
        return None
    return _Followed(source, e, weight, float(weighted @ own.ordinates) / normal, normal)


def _candidate(view: View, name: str, own: _Own) -> Candidate | None:
    """Return the coupling from a source as a candidate."""
    found, d = _followed(view, name, own), own.ordinates
    if found is None:
        return None
    alternatives = (len(view.series.axes) - 1) * len(view.sources(name))
    price = float(chdtri(1, ALPHA / alternatives)) / 2
    if found.gain < price or not _same_everywhere(d, found) or not _same_all_along(d, found):
        return None
    # Of two that are one signal neither couples into the other.
    if multiple_of(view.series, view.axis, name) is not None or not _in_phase(view, found):
        return None
    telling = _telling(view, name) / max(1.0, _UNEQUAL * found.gain / _AMBIGUOUS)
    if telling < -_AMBIGUOUS:
        return None
    column = view.series.column
    removed = bool((telling, column(view.axis)) > (0.0, column(name)))
    unit = f"{view.unit}/{view.unit_of(name)}"
    slope, error = _measured(view, d, found)
    effect = CrossCoupling(Parameter(name), Estimate.of(slope, error, unit), telling, removed)
    x = found.source.rows
    return Candidate(
        effect,
        found.gain,
        price + float(np.log(ALPHA)),
        signal=slope * (x - x.mean()) if removed else None,
        rivals={} if _is_seen_fast(view, d, found, price) else {"temperature": found.gain},
        axes=(view.axis, name) if effect.is_open else (view.axis,),
    )


def _measured(view: View, d: Array, found: _Followed) -> tuple[float, float]:
    """Return the slope and its error under the noise that is left without the coupling.

    As found, what leaks in counts as noise of the axis: where the source is loudest, and tells
    most, the axis seems loudest too. That is right for a detection, too wide for an interval.
    """
    rest = view.ordinates - found.slope * found.source.ordinates
    power = view.grid.binned(rest**2, view.excluded)[0]
    spectrum = view.fitter.fit(power, view.spectrum.powers)
    weight = (found.weight > 0) / spectrum.ordinates
    e = found.ordinates
    normal = float(np.sum(e * e * weight))
    return float(np.sum(e * d * weight)) / normal, float(1 / np.sqrt(normal))


def _without_temperature(view: View, ordinates: Array) -> Array:
    """Take out of an axis what the measured temperature explains."""
    warmth = view.series.thermal_ordinates
    if warmth is None:
        return ordinates
    slow = slice(_FIRST, view.grid.low)
    weight = view.spectrum.kept[slow] / view.spectrum.ordinates[slow]
    normal = float(np.sum(warmth[slow] ** 2 * weight))
    if normal <= 0:
        return ordinates
    rest = ordinates.copy()
    rest[slow] -= warmth[slow] * (float(np.sum(warmth[slow] * ordinates[slow] * weight)) / normal)
    return rest


def _is_seen_fast(view: View, d: Array, found: _Followed, price: float) -> bool:
    """Return whether frequencies at which no temperature moves are enough to see it."""
    e, weight = found.ordinates, found.weight
    first = int(_SLOW_HZ * 2 * view.grid.n / view.grid.rate_hz)
    normal = float(np.sum(e[first:] ** 2 * weight[first:]))
    score = float(np.sum(e[first:] * d[first:] * weight[first:]))
    return score**2 > 2 * price * normal


def _same_everywhere(d: Array, found: _Followed) -> bool:
    """Return whether the slopes in separate bands agree with the common one (1 in 1000)."""
    e, weight, slope = found.ordinates, found.weight, found.slope
    bounds = np.unique(np.geomspace(_FIRST, len(d), _BANDS + 1).astype(int))
    distance, freedom = 0.0, -1
    for low, high in pairwise(bounds):
        normal = float(np.sum(e[low:high] ** 2 * weight[low:high]))
        if normal > 0:
            own = float(np.sum(e[low:high] * d[low:high] * weight[low:high])) / normal
            distance += (own - slope) ** 2 * normal
            freedom += 1
    return freedom < 1 or bool(chdtrc(freedom, distance) > 1e-3)


def _same_all_along(d: Array, found: _Followed) -> bool:
    """Return whether it is there while the source is quiet, as far as that can be told."""
    root = np.sqrt(found.weight)
    x, y = (in_time(one * root) for one in (found.ordinates, d))
    stretches = np.array_split(np.arange(len(x)), _STRETCHES)
    stretches.sort(key=lambda rows: float(np.mean(x[rows] ** 2)))
    quiet, loud = (
        _slope(np.concatenate(half), x, y)
        for half in (stretches[: _STRETCHES // 2], stretches[_STRETCHES // 2 :])
    )
    apart = abs(loud[0] - quiet[0]) > _APART * np.hypot(quiet[1], loud[1])
    return not apart or quiet[0] * loud[0] > _OF_THE_LOUD * loud[0] ** 2


def _slope(rows: NDArray[np.intp], x: Array, y: Array) -> tuple[float, float]:
    """Return the slope in some rows and its standard error, under the noise there."""
    normal = max(float(x[rows] @ x[rows]), np.finfo(float).tiny)
    slope = float(x[rows] @ y[rows]) / normal
    variance = float(np.mean((y[rows] - slope * x[rows]) ** 2))
    return slope, float(np.sqrt(variance / normal))


def _in_phase(view: View, found: _Followed) -> bool:
    """Return whether the quadrature part of the cross-spectrum is nothing, or little of the gain.

    Judged above the frequencies of drifts, which differ in time from axis to axis. The scatter of
    every band is that of the model or, where it is larger, that of the bins themselves.
    """
    n, x, weight = view.grid.n, found.source.rows, found.weight
    taper = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(n) + 0.5) / n)
    size = np.sqrt(n * np.mean(taper**2))
    y = view.data - view.data.mean()
    own = np.asarray(rfft(taper * y))[1:] / size
    other = np.asarray(rfft(taper * (x - x.mean())))[1:] / size
    # Bin k lies at ordinate 2 k; the taper mixes those around it in.
    at = np.minimum(2 * np.arange(1, len(own) + 1) - 1, n - 2)
    around = [np.clip(at + shift, 0, n - 2) for shift in (-2, -1, 1, 2)]
    mixed = weight[at] * np.logical_and.reduce([weight[j] > 0 for j in around])
    turned = np.imag(np.conj(other) * own) * mixed
    expected = np.abs(other) ** 2 * mixed / 2
    first = max(_FIRST // 2, int(_SLOW_HZ * n / view.grid.rate_hz))
    if first >= len(own):
        return True
    bounds = np.unique(np.geomspace(first, len(own), _BANDS + 1).astype(int))
    distance, freedom = 0.0, 0
    for low, high in pairwise(bounds):
        modelled = float(np.sum(expected[low:high]))
        if modelled > 0:
            scatter = max(modelled, float(np.sum(turned[low:high] ** 2)))
            distance += float(np.sum(turned[low:high])) ** 2 / (_OF_THE_TAPER * scatter)
            freedom += 1
    little = distance - freedom < _IN_QUADRATURE * 2 * found.gain
    return freedom == 0 or little or bool(chdtrc(freedom, distance) > _TURNED_P)


def _telling(view: View, name: str) -> float:
    """Return `_direction`, which the record tells whatever has been found."""
    known = view.series.directions
    if (view.axis, name) not in known:
        known[view.axis, name] = _direction(view, name)
    return known[view.axis, name]


def _direction(view: View, name: str) -> float:
    """Gain of this axis taking from the source less that of the source taking from this axis.

    Both as measured but for shocks, each with a level of its own in every narrow band: what a model
    of the noise misses would tell a direction. A line or a shock that came along with the rest has
    one origin, and taking the right share of the right axis removes it. One that neither removes is
    not from the coupling.
    """
    pair = [view.series.source(axis, view.series.all_shocks) for axis in (view.axis, name)]
    lines: NDArray[np.bool_] = np.logical_or.reduce([one.loud | one.lines for one in pair])
    lines[:_FIRST] = False
    edges = [_FIRST]
    while (edge := edges[-1] + max(_FEWEST, int(_WIDTH * edges[-1]))) < len(lines) - _FEWEST:
        edges.append(edge)
    noise = _Bands.of(edges, ~lines, _FEWEST // 2)
    if not len(noise.count):
        return 0.0
    changes = np.flatnonzero(np.diff(lines, prepend=False))
    runs = _Bands.of(changes.tolist(), lines) if len(changes) else None

    def slope_of(ordinates: Array, of: Array) -> float:
        left, slope = ordinates, 0.0
        for _ in range(_ROUNDS):
            weight = noise.spread(1 / noise.power(left), len(lines))
            normal = float(np.sum(of**2 * weight))
            slope = float(np.sum(of * ordinates * weight)) / normal if normal > 0 else 0.0
            left = ordinates - slope * of
        return slope

    own, other = (one.ordinates for one in pair)
    slopes = slope_of(own, other), slope_of(other, own)
    both = (own, own - slopes[0] * other), (other, other - slopes[1] * own)
    gains = [noise.count * np.log(noise.power(x) / noise.power(y)) / 2 for x, y in both]
    telling = float(np.sum(gains[0] - gains[1])) + _told_by_shocks(view, name, slopes)
    if runs is None:
        return telling

    def above(ordinates: Array) -> Array:
        level = np.interp(runs.middle, noise.middle, noise.power(ordinates))
        return (runs.power(ordinates) / level - 1) * np.sqrt(runs.count / 2)

    before, after = ([above(pair[i]) for pair in both] for i in (0, 1))
    came_along = _came_along(before, after)
    gains = [runs.count * np.log(runs.power(x) / runs.power(y)) / 2 for x, y in both]
    return telling + float(np.sum((gains[0] - gains[1])[came_along]))


def _came_along(before: list[Array], after: list[Array]) -> NDArray[np.bool_]:
    """Tell what is on both axes, and gone from one of the two once its share of the other is.

    Both hold powers above the noise of both axes, in standard errors.
    """
    first, last = np.sort(before, axis=0), np.sort(after, axis=0)
    return np.asarray((first[0] > _GONE) & (last[0] < _GONE) & (last[1] > _THERE))


def _told_by_shocks(view: View, name: str, slopes: tuple[float, float]) -> float:
    """Return what the shocks that came along add to the direction."""
    own, other = (view.series.source(axis).rows for axis in (view.axis, name))
    both = (own, own - slopes[0] * other), (other, other - slopes[1] * own)
    telling = 0.0
    for shaken in view.series.shocks:
        if {view.axis, name}.isdisjoint(shaken.axes):
            continue
        first, stop = shaken.first, shaken.stop
        before, after = ([_above(pair[i], first, stop) for pair in both] for i in (0, 1))
        if _came_along(before, after):
            gains = [np.log(x[first:stop].var() / left[first:stop].var()) for x, left in both]
            telling += (stop - first) / 2 * float(gains[0] - gains[1])
    return telling


def _above(x: Array, first: int, stop: int) -> Array:
    """Return the power of some rows above that of as many elsewhere, in standard errors."""
    size = stop - first
    usual = np.median(x[: len(x) // size * size].reshape(-1, size).var(axis=1))
    power = x[first:stop].var() / max(float(usual), np.finfo(float).tiny)
    return np.asarray((power - 1) * np.sqrt(size / 2))


@dataclass(frozen=True)
class _Bands:
    """Bands of some of the ordinates.

    Attributes
    ----------
    edges : list of int
        First ordinate of each; the last one ends with the record.
    used : ndarray of bool, shape (n - 1,)
        Ordinates that count.
    count, middle : ndarray, shape (b,)
        How many of them a band has, and where its middle is; bands of too few are left out.
    known : ndarray of bool
        Bands that are not.
    """

    edges: list[int]
    used: NDArray[np.bool_]
    count: Array
    middle: Array
    known: NDArray[np.bool_]

    @classmethod
    def of(cls, edges: list[int], used: NDArray[np.bool_], fewest: int = 1) -> Self:
        """Return bands between edges that have so many ordinates at least."""
        count = np.add.reduceat(used.astype(np.float64), edges)
        known = count >= fewest
        middle = 0.5 * (np.array(edges) + np.append(edges[1:], len(used)))
        return cls(edges, used, count[known], middle[known], known)

    def power(self, ordinates: Array) -> Array:
        """Return the mean square in each band, never nothing."""
        power = np.add.reduceat(ordinates**2 * self.used, self.edges)[self.known] / self.count
        return np.maximum(power, np.finfo(float).tiny)

    def spread(self, values: Array, size: int) -> Array:
        """Return values of bands at their ordinates, 0 at all others."""
        everywhere = np.zeros(len(self.edges))
        everywhere[self.known] = values
        lengths = np.diff(self.edges, append=size)
        return np.concatenate([np.zeros(self.edges[0]), np.repeat(everywhere, lengths)]) * self.used
