"""From what a bank holds to the variances of any estimator, and how long until there is one.

Three ways lead there: sums of the cascade; a multiple of another variance (TVAR of MVAR); and, for
the modified totals and the Theo family, the archive.

As long as the archive has a row for each sample, and no more than 4096, every window is taken and
the values are those of the definition. Then MTOT's windows start at every eighth of m only, HTOT's
at every sixteenth, and once rows are joined those of the Theo family at every 128th. That scatters
a deviation by less than 1.1 % rms at an eighth of the run, a thirtieth of its standard deviation;
HTOT and THEO1 of phase noise by 1.5 %, as much as that. Joined rows begin at 32 to an m: the long
taus for which these estimators exist, from 1/128 of the run up, all lie above that. The expectation
is then within 0.1 % of the full rate for MTOT, HTOT and THEO1 (2 % for THEO1 of phase noise).
TheoBR treats the picked phases as a record in its own right, which adds 1.7 % times 32 / rows for
flicker and random walk; its share of TheoH begins at 500 rows.
All this is measured by `benchmarks/thinning.py`.

How many samples more give a value (`samples_to_value`) follows from counts alone. A bank has
averaging factors of its own: those of its rungs and, for what is evaluated from the archive,
multiples of the archive's stride, which doubles whenever its room is full. The one nearest to the
time that is required is meant.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan.archive import Archive
from allanscope.allan.cascade import Cascade
from allanscope.allan.estimators import Estimator, Sums, estimator_named
from allanscope.allan.estimators.htotdev import htot_variance
from allanscope.allan.estimators.mtotdev import mtot_variance
from allanscope.allan.estimators.theo1 import theo1_profile, thinned_variance_of, variance_of
from allanscope.allan.estimators.theobr import theobr_ratio
from allanscope.allan.kernels import COLUMNS
from allanscope.allan.long_taus import KINDS, Segment, running_sums, with_rows
from allanscope.allan.noise_type import (
    NoiseTypes,
    identify,
    levels_of,
    steep_levels,
    without_drift,
)

__all__ = ["Curves", "factors_of_rows", "samples_to_value"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_ALL_WINDOWS = 4096
"""Rows up to which every window of a total is taken: half a second for six axes."""

_WINDOWS_PER_TAU = {"mtotdev": 8, "htotdev": 16, "theo1": 128, "theobr": 128}
"""Windows that start within m, of a longer archive."""
_FEWEST_ROWS = 32
_FEWEST_PHASES = 10
"""Shortest window of the Theo family that SP 1065 recommends."""
_THEO = ("theo1", "theobr")
"""Estimators that weight the same sums."""
_SHORTEST = math.sqrt(0.5)
"""An averaging time below this part of the shortest one of the bank is none of its own."""


class Curves:
    """Variances of one moment, each evaluated once.

    Parameters
    ----------
    cascade : Cascade
        Closed.
    archive : Archive
        Of the same samples.
    """

    def __init__(self, cascade: Cascade, archive: Archive) -> None:
        self._cascade = cascade
        self._archive = archive
        self._known: dict[str, Sums] = {}
        self._noise: NoiseTypes | None = None
        self._profiles: dict[tuple[int, int, int], Floats] = {}

    @cached_property
    def _running(self) -> list[list[Segment]]:
        return [running_sums(self._archive, axis) for axis in range(self._archive.axes)]

    def sums(self, kind: str) -> Sums:
        """Return the variances of an estimator, of shape (axes, k), in (unit of the samples)^2.

        Raises
        ------
        ValueError
            For an unknown kind.
        """
        if kind not in self._known:
            self._known[kind] = self._evaluate(kind)
        return self._known[kind]

    def noise_types(self, kind: str, sums: Sums) -> NoiseTypes | None:
        """Return the noise at the taus of `sums`; None when there is no telling."""
        return self.noise_at(estimator_named(kind).tau(sums.m, sums.n))

    def noise_at(self, tau: ArrayLike) -> NoiseTypes | None:
        """Return the noise at averaging times in samples; None without any value."""
        allan = self.sums("oadev")
        # At powers of two only: the finer taus of a bank must not change what an array is told.
        octave = (allan.m & (allan.m - 1)) == 0
        if not octave.any():
            return None
        if self._noise is None:
            self._noise = self._identified(allan, octave)
        return self._noise.at(tau, allan.m[octave])

    def _identified(self, allan: Sums, octave: NDArray[np.bool_]) -> NoiseTypes:
        standard, hadamard, modified = (
            _on_taus(self.sums(kind), allan.m)[:, octave] for kind in ("ostdev", "ohdev", "mdev")
        )
        m, n = allan.m[octave], allan.n
        plain = without_drift(
            m,
            n,
            allan.variance[:, octave],
            modified,
            self._archive.drift(),
            self._archive.mean_second_differences(m),
        )
        alpha = identify(m, n, stdvar=standard, avar=plain[0], hvar=hadamard, mvar=plain[1])
        return NoiseTypes(
            alpha, levels_of(m, n, *plain, alpha), steep_levels(m, n, hadamard, alpha)
        )

    def _evaluate(self, kind: str) -> Sums:
        estimator = estimator_named(kind)
        if kind in COLUMNS:
            sums = self._cascade.variances(kind)
            if kind not in KINDS:
                return sums
            return with_rows(kind, sums, self._archive, lambda: self._running)
        if estimator.derived_from:
            parent = self.sums(estimator.derived_from)
            return replace(parent, variance=parent.variance * estimator.factor(parent.m))
        if kind == "theoh":
            return self._hybrid(estimator)
        return self._from_archive(estimator)

    def _hybrid(self, theoh: Estimator) -> Sums:
        """Join OAVAR at short tau and TheoBR at long."""
        n = self._cascade.samples
        parts = []
        for kind in ("oadev", "theobr"):
            sums = self.sums(kind)
            at_own_tau = theoh.tau(sums.m, n) == estimator_named(kind).tau(sums.m, n)
            admitted = [theoh.admits(m, n) for m in sums.m.tolist()]
            parts.append((sums, at_own_tau & np.array(admitted, np.bool_)))

        def joined(name: str) -> NDArray[Any]:
            return np.concatenate([getattr(sums, name)[..., keep] for sums, keep in parts], axis=-1)

        names = ("m", "variance", "terms", "stride", "segments", "covered")
        return Sums(n=n, **{name: joined(name) for name in names})

    def _from_archive(self, estimator: Estimator) -> Sums:
        archive = self._archive
        factors = factors_of_rows(estimator, archive.stride, archive.used, self._cascade.per_octave)
        few = archive.used <= _ALL_WINDOWS or estimator.name in _THEO
        every = few and archive.stride == 1
        windows = factors if every else _WINDOWS_PER_TAU.get(estimator.name, factors)
        step = np.maximum(factors // windows, 1)
        pooled = [self._pooled(estimator, axis, factors, step) for axis in range(archive.axes)]
        squares, terms, segments, covered = np.stack(pooled, axis=1)
        have = terms.any(axis=0)
        with np.errstate(invalid="ignore"):
            mean = squares[:, have] / terms[:, have]
        return Sums(
            m=factors[have] * archive.stride,
            variance=mean,
            terms=terms[:, have].astype(np.int64),
            stride=step[have] * archive.stride,
            n=self._cascade.samples,
            segments=segments.max(axis=0)[have].astype(np.int64),
            covered=covered.max(axis=0)[have].astype(np.int64),
        )

    def _pooled(self, estimator: Estimator, axis: int, factors: Ints, step: Ints) -> Floats:
        """Return squares, windows, segments that have any, and their samples; shape (4, k)."""
        archive = self._archive
        pooled = np.zeros((4, factors.size))
        averaged = estimator.name == "mtotdev"
        phases = archive.averaged(axis) if averaged else archive.picked(axis)
        for segment, phase in enumerate(phases):
            fit = np.flatnonzero(factors < phase.size)
            if estimator.name in _THEO and archive.stride > 1:
                found = self._theo(estimator.name, axis, segment, phase, factors[fit], step[fit])
            else:
                found = _windows(estimator, phase, factors[fit], step[fit], archive.stride)
            for t, (variance, windows) in zip(fit, found, strict=True):
                if windows:
                    covered = (phase.size - 1) * archive.stride
                    pooled[:, t] += variance * windows, windows, 1, covered
        return pooled

    def _theo(
        self, kind: str, axis: int, segment: int, phase: Floats, factors: Ints, step: Ints
    ) -> list[tuple[float, int]]:
        """Return variance and windows of THEO1 or TheoBR, which weight the same sums."""
        stride = self._archive.stride
        ratio = theobr_ratio(phase) if kind == "theobr" else 1.0
        if not np.isfinite(ratio):
            return [(np.nan, 0)] * len(factors)
        found = []
        for k, by in zip(factors.tolist(), step.tolist(), strict=True):
            at = axis, segment, k
            if at in self._profiles:  # the other has been asked for, each is once
                profile = self._profiles.pop(at)
            else:
                profile = self._profiles[at] = theo1_profile(phase, k, by)
            if kind == "theobr":
                variance = ratio * variance_of(profile) / stride**2
            else:
                variance = thinned_variance_of(profile, stride)
            found.append((variance, len(range(0, phase.size - k, by))))
        return found


def factors_of_rows(estimator: Estimator, stride: int, used: int, per_octave: int) -> Ints:
    """Return the averaging factors that `used` rows of an archive serve, in rows, ascending."""
    octaves = np.arange(per_octave * np.log2(max(used, 1)) + 1)
    factors = np.round(2.0 ** (octaves / per_octave)).astype(np.int64)
    fewest = 1 if stride == 1 else _FEWEST_ROWS
    if estimator.even:
        factors = 2 * np.round(factors / 2).astype(np.int64)
        fewest = max(fewest, _FEWEST_PHASES)
    return np.unique(factors[factors >= fewest])


def _windows(
    estimator: Estimator, phase: Floats, factors: Ints, step: Ints, stride: int
) -> list[tuple[float, int]]:
    """Return variance for tau0 of one sample, and windows, at each factor of one segment."""
    pairs = list(zip(factors.tolist(), step.tolist(), strict=True))
    match estimator.name:
        case "mtotdev":
            found = [mtot_variance(phase, k, by) for k, by in pairs]
        case "htotdev":
            found = [htot_variance(phase, k, by) for k, by in pairs]
        case _:
            found = estimator.curve(phase, factors.tolist())
    return [(variance / stride**2, windows) for variance, windows in found]


def _on_taus(sums: Sums, m: Ints) -> Floats:
    """Return variances at the first taus of a grid they share; NaN where there is none."""
    variance = np.full((sums.variance.shape[0], m.size), np.nan)
    shared = min(m.size, sums.m.size)
    variance[:, :shared] = sums.variance[:, :shared]
    return variance


def samples_to_value(
    kind: str, tau: float, curves: Curves, cascade: Cascade, archive: Archive
) -> float:
    """Return how many samples more give every axis a value; inf where none is to come.

    Parameters
    ----------
    kind : str
        Name in `REGISTRY`.
    tau : float
        Averaging time in samples.
    curves : Curves
        Values there are.
    cascade, archive : Cascade, Archive
        What the bank holds. No gap is foreseen.
    """
    if kind != "theoh":
        return _to_part(kind, tau, curves, cascade, archive)[0]
    # Two curves in one, which meet at a tenth of the run, and that grows while one waits.
    n = cascade.samples
    more, m = _to_part("theobr", tau, curves, cascade, archive)
    if 0.75 * m > 0.1 * (n + more):
        return more
    more, m = _to_part("oadev", tau, curves, cascade, archive)
    return max(more, 10 * m - n)


def _to_part(
    kind: str, tau: float, curves: Curves, cascade: Cascade, archive: Archive
) -> tuple[float, int]:
    """Return the samples missing, and the averaging factor that will then be the nearest."""
    estimator = estimator_named(kind)
    window = tau / estimator.tau_factor
    name = estimator.derived_from or kind
    if name in COLUMNS:
        m = _nearest(cascade.factors_near(window), window)
        return (cascade.missing(name, m, estimator.min_terms) if m else math.inf), m
    stride, rows = archive.stride, archive.rows.shape[2]
    closed = np.diff(archive.starts)
    taken = since = (archive.used - archive.starts[-1]) * stride + archive.filled
    while m := stride * _nearest(
        factors_of_rows(estimator, stride, rows, cascade.per_octave), window / stride
    ):
        if stride == archive.stride and _has_value(kind, m, curves):
            return 0, m
        # Now there is one as soon as the open segment has the rows, unless no room is left then.
        # Averaged phases are one fewer than picked ones, once a row is more than a sample.
        needed = estimator.needed(m // stride) + (name == "mtotdev" and stride > 1)
        until = since if (closed >= needed).any() else max(since, needed * stride)
        full = (rows - int(closed.sum()) + 1) * stride
        if until < full:
            # A segment that has the rows and no value is of one level, as may be all to come.
            return (until - taken or math.inf), m
        closed, stride, since = closed // 2, 2 * stride, full
    return math.inf, 0


def _has_value(kind: str, m: int, curves: Curves) -> bool:
    sums = curves.sums(kind)
    there = sums.m == m
    return bool(there.any() and np.isfinite(sums.variance[:, there]).all())


def _nearest(factors: NDArray[np.int64], window: float) -> int:
    """Return the factor nearest to a window by ratio; 0 for a window shorter than all."""
    if window < _SHORTEST * factors[0]:
        return 0
    return int(factors[np.argmin(np.abs(np.log(factors / window)))])
