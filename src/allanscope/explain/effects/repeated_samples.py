r"""Rows that repeat the row before: a reader faster than the sensor, a stuck bus, a filled gap.

Two neighbours may be equal by chance, the more so on a coarse lattice or behind a low-pass. A row
of a sensor repeats on all its axes. With several, all of them, or all of the record, repeat at once
far more often than the product of their own chances, times what rows far from each other show of
their dependence (`values`).
With one: differences of 0 are more frequent than those of +-1, +-2, +-3 steps let expect, whose
frequencies follow a Gaussian whatever filter came before; by as much as they are among rows far
from each other this is the shape of the distribution. On a lattice too fine for that, or without
one, it is the share of zeros among small differences that is compared with that of far rows.
White noise held with probability d has

.. math:: S(f) = N^2 (1 - d^2) / (1 - 2 d \cos 2\pi f/f_s + d^2),

which enters the model as a factor on the white part. Where the repeats come in a pattern (a reader
at twice the rate of the sensor: every second row) the chance :math:`r_j` that j rows in a row are
repeats is not d^j, and the factor is :math:`1 + 2 \sum_j r_j \cos 2\pi j f/f_s`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.effects.dead_zone import values_beside
from allanscope.explain.values import Coincidence, beyond_runs, typical_and_limit
from allanscope.explain.view import View
from allanscope.noise.filters import Filter, HeldPattern, HeldSamples
from allanscope.optimise import root_between
from allanscope.quantities import TWO_SIDED_95

Array = NDArray[np.float64]

_BEYOND = 1.05
"""Less excess over chance than this may come from rates of chance that change together."""
_LONGEST_RUN, _RARE = 16, 1e-3
"""Rows in a row that are looked at, and the chance of such a run below which it changes nothing."""
_MOSTLY = 0.05
"""Relative excess of equal rows over repeats up to which the runs of these are seen in those."""
_PATTERN = 0.2
"""Relative difference from chance of some repeats in a row from which they come in a pattern. Of a
sensor that is read three times, now and then four, three in a row show it, and two hardly."""
_JOINED = 0.3
"""Runs joined by rows that are equal by chance are known to this part of the chance."""
_FINEST = 0.8
"""Least noise in steps at which a single axis can be judged."""
_FEWEST = 30
"""Differences of each size that a Gaussian can be put through."""
_SMALL = 0.25
"""A difference is small below this share of the median."""
_UNSEEN = 3.0
"""Upper 95 % limit of what was expected where nothing was seen."""
_NONE = (0.0, 0.0, 1.0)
"""Fraction, gain and error factor where nothing repeats."""
_ALONE = 0.02
"""Least fraction of one axis alone, where others of its sensor are there to tell: a smaller excess
of equal neighbours is that of coarse values which are not quite Gaussian."""
_SLOWER = 0.8
"""A sensor that makes less than this part of the samples that all make at once is slower than the
other: what all repeat at once is the other's."""
_LOOKED_AT, _PIECES = 1 << 17, 16
"""Rows of a long record that tell how its far rows differ, and pieces that they come from."""


@dataclass(frozen=True)
class RepeatedSamples(EffectKind):
    """Repeated rows."""

    fraction: Estimate

    kind = "repeated_samples"
    meaning = "rows repeat the row before"
    phrase = "{fraction} of the samples repeated"
    as_cause = "repeated samples"
    acts_slow = False
    has_one_cause = True
    needs = frozenset({"samples"})
    stage = 0
    is_single = True
    repeats_rows = True
    is_not_gaussian = True
    confused_with: ClassVar[Mapping[str, str]] = {
        "band_limit": "a filter makes neighbours alike, not equal",
        "quantization": "few values repeat by chance, each axis on its own",
        "saturation": "neighbours are equal at the end of the range alone",
    }

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return f"{100 * self.fraction.value:.3g} % of the rows repeat the row before"

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Count equal neighbours."""
        series = view.series
        column, moving = series.column(view.axis), series.moving
        if column not in moving:
            return []
        sensor = tuple(c for c in moving if series.axes[c][0] == view.axis[0])
        groups = {moving, sensor} if len(sensor) > 1 else {moving}
        together = [(_counted(view, group), group) for group in groups if len(group) > 1]
        found, columns = max(together, key=lambda one: one[0][1], default=(_NONE, sensor))
        slowest, own = max(together, key=lambda one: one[0][0], default=(_NONE, sensor))
        if 1 - slowest[0] < _SLOWER * (1 - found[0]):
            found, columns = slowest, own
        least = max(3 * found[0], _ALONE if len(sensor) > 1 else 0.0)
        alone = _counted(view, (column,), least)
        if alone[1] > found[1] and alone[0] >= least:
            found, columns = alone, (column,)
        fraction, gain, rows = found
        equal = series.equal[:, columns]
        error = np.sqrt(max(fraction * (1 - fraction), 1 / len(equal)) / len(equal)) * rows
        share = Estimate(
            fraction, max(0.0, fraction - TWO_SIDED_95 * error), fraction + TWO_SIDED_95 * error
        )
        held, axes = _held(equal, fraction), tuple(series.axes[c] for c in columns)
        return [Candidate(cls(share), gain, float(np.log(2)), parts=(held,), axes=axes)]


def _counted(
    view: View, columns: tuple[int, ...], least: float = 0.0
) -> tuple[float, float, float]:
    """Return fraction, gain and error factor of some axes, counted once for all of them.

    Of one axis alone, nothing where the fraction is below the least.
    """
    series = view.series
    if columns not in series.repeats:
        equal = series.equal[:, columns]
        if len(columns) == 1:
            series.repeats[columns] = _alone(view, equal[:, 0], least)
        else:
            series.repeats[columns] = _together(series.values[:, columns], equal)
    return series.repeats[columns]


def _held(equal: NDArray[np.bool_], fraction: float) -> Filter:
    """Return the factor on the white part, by the pattern of the repeats where it is seen."""
    repeat: NDArray[np.bool_] = np.logical_and.reduce(equal, axis=1)
    chances = []
    runs = repeat
    for j in range(1, _LONGEST_RUN + 1):
        chances.append(float(runs.mean()))
        if chances[-1] < _RARE:
            break
        runs = runs[:-1] & repeat[j:]
    seen = abs(chances[0] - fraction) < max(_RARE, _MOSTLY * fraction) and len(chances) > 1
    independent = fraction ** np.arange(2, len(chances) + 1)
    by_counting = 3 * np.sqrt(independent / len(repeat) * (1 + fraction) / (1 - fraction))
    off = np.abs(np.array(chances[1:]) - independent)
    if seen and np.any(off > _PATTERN * independent + by_counting):
        # Rows that are equal by chance join two runs; of j rows, one of j (1 - d) may be such.
        chance = (chances[0] - fraction) / (1 - fraction)
        joined = chance * np.minimum(1.0, np.arange(1, len(chances) + 1) * (1 - fraction))
        own = (np.array(chances) - joined)[:-1]
        return HeldPattern(tuple(own[own > _JOINED * chance].tolist()))
    return HeldSamples(min(fraction, 0.95))


def _together(values: Array, equal: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Return fraction, gain and error factor from all axes repeating at once.

    With a share d of repeated rows, axis i repeats with P_i = d + (1 - d) p_i and all of them with
    P = d + (1 - d) c prod p_i, where c is their `dependence`; without any, P = c prod P_i.
    """
    n, axes = equal.shape
    each, share = equal.mean(axis=0), float(equal.all(axis=1).mean())
    chance = float(np.prod(each))  # of independent axes: the least
    if share * n < 3 or share < _BEYOND * chance:
        return _NONE
    by_chance = Coincidence.of(values, equal)
    dependence = by_chance.dependence
    chance *= by_chance.limit
    if share < _BEYOND * chance:
        return _NONE

    def excess(d: float) -> float:
        return float(d + dependence * np.prod(each - d) / (1 - d) ** (axes - 1) - share)

    top = float(each.min())
    fraction = root_between(excess, 0.0, top) if excess(top) > 0 > excess(0.0) else share
    floor = max(chance * n, by_chance.far * n, 0.05)
    if share * n <= floor:
        return _NONE
    return fraction, share * n * float(np.log(share * n / floor)) - (share * n - floor), 1.0


def _alone(view: View, equal: NDArray[np.bool_], least: float) -> tuple[float, float, float]:
    """Return the same from one axis, by the differences of neighbours and of far rows."""
    whole = _within_limits(view)
    if np.count_nonzero(np.isfinite(whole)) < _FEWEST:
        return _NONE
    samples = _some(whole)
    lags = beyond_runs(equal)
    if view.step <= 0:
        return _among_small(whole, samples, lags)
    codes = _apart(whole, 1, view.step)
    scatter = float(np.std(codes))
    if scatter / np.sqrt(2) < _FINEST:
        return _NONE
    reach = int(np.clip(scatter, 3, 12))
    fit = _zeros(codes, reach)
    if fit is None:
        return _among_small(whole, samples, lags)
    zeros, expected, sigma2 = fit
    variance = expected + expected**2 * sigma2
    if zeros - expected <= least * len(codes):  # far rows can only add to what is expected
        return 0.0, 0.0, float(np.sqrt(variance))
    far = [_zeros(_apart(samples, lag, view.step), reach) for lag in lags]
    known = [one for one in far if one is not None]
    typical, limit = typical_and_limit(
        np.array([one[0] / one[1] for one in known]),
        np.array([np.sqrt(1 / max(one[0], 1.0) + one[2]) for one in known]),
    )
    n = len(codes)
    excess = zeros - expected * max(1.0, typical)
    z = max(0.0, zeros - expected * max(1.0, limit)) / np.sqrt(variance)
    fraction = max(0.0, excess / n)
    factor = float(np.sqrt(variance + max(excess, 0.0)) / np.sqrt(max(excess, 1.0)))
    return fraction, float(z * z / 2), factor


def _within_limits(view: View) -> Array:
    """Return the samples, NaN at a limit or in a dead zone, where equal ones are no repeats."""
    limits = [
        crowded.value
        for crowded in view.crowded_codes
        if crowded.side or values_beside(view, crowded)
    ]
    return np.where(np.isin(view.samples, limits), np.nan, view.samples) if limits else view.samples


def _apart(samples: Array, lag: int, step: float) -> Array:
    """Return by how many steps samples at a distance differ, of those within the limits."""
    steps = np.round((samples[lag:] - samples[:-lag]) / step)
    return steps[np.isfinite(steps)]


def _zeros(codes: Array, reach: int) -> tuple[float, float, float] | None:
    """Return differences of 0, how many a Gaussian through the others expects, and its variance.

    The variance is relative. None where the others are too few to tell.
    """
    sizes = np.minimum(np.abs(codes), reach + 1).astype(np.int64)
    counts = np.bincount(sizes, minlength=reach + 1)[: reach + 1].astype(np.float64)
    if counts[1:].min() < _FEWEST:
        return None
    j = np.arange(1, reach + 1)
    design = np.column_stack([np.ones(reach), -(j**2.0)])
    weight = np.sqrt(counts[1:])
    solution, *_ = np.linalg.lstsq(
        design * weight[:, np.newaxis], np.log(counts[1:] / 2) * weight, rcond=None
    )
    sigma2 = float(np.linalg.inv((design * weight[:, np.newaxis] ** 2).T @ design)[0, 0])
    # Where no Gaussian goes through the others, it tells as little about 0 as it is off there.
    off = (np.log(counts[1:] / 2) - design @ solution) * weight
    sigma2 *= max(1.0, float(off @ off) / (reach - 2))
    return float(counts[0]), float(np.exp(solution[0])), sigma2


def _among_small(samples: Array, some: Array, lags: range) -> tuple[float, float, float]:
    """Return the same where there is no lattice to count on: zeros among small differences."""
    steps = np.abs(np.diff(samples))
    far = [np.abs(some[lag:] - some[:-lag]) for lag in lags]
    if not far:
        return _NONE
    small = _SMALL * float(np.nanmedian(np.concatenate(far)))
    near = float(np.count_nonzero((steps > 0) & (steps <= small)))
    others = np.array([np.count_nonzero((one > 0) & (one <= small)) for one in far], float)
    zeros = np.array([np.count_nonzero(one == 0) for one in far], float)
    if not others.min() > 0:
        return _NONE
    # Where far rows are never equal, three in all of them could have been and were not seen.
    relative = np.full(len(far), 1.0 / np.sqrt(max(float(zeros.mean()), 1.0)))
    typical, limit = typical_and_limit(zeros / others, relative)
    rows, equal = np.count_nonzero(np.isfinite(steps)), float(np.count_nonzero(steps == 0))
    chance = max(near * max(limit, _UNSEEN / float(others.sum())), 0.05)
    if equal <= _BEYOND * chance:
        return _NONE
    gain = equal * float(np.log(equal / chance)) - (equal - chance)
    return (equal - near * typical) / rows, gain, 1.0


def _some(samples: Array) -> Array:
    """Return evenly spread pieces of a long record: enough to know its distribution."""
    if len(samples) <= _LOOKED_AT:
        return samples
    starts = np.linspace(0, len(samples) - _LOOKED_AT // _PIECES, _PIECES).astype(int)
    return np.concatenate([samples[at : at + _LOOKED_AT // _PIECES] for at in starts])
