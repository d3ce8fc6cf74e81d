"""What the loop shows to every effect: data of one axis, what is explained so far, the noise."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from allanscope.explain.candidate import Candidate
from allanscope.explain.crowded_codes import CrowdedCode, crowded_codes, missing_codes
from allanscope.explain.effect import SearchStep
from allanscope.explain.series import Series, Source, in_time
from allanscope.explain.spectrum import Spectrum, SpectrumFitter, StepScan
from allanscope.explain.values import step_of
from allanscope.lazy import once
from allanscope.noise import NoiseModel
from allanscope.noise.components import Component, Flicker, RandomWalk, Rounding, White
from allanscope.noise.filters import HeldPattern, HeldSamples
from allanscope.noise.grid import Grid, Ranges
from allanscope.noise.part import Filter, Part
from allanscope.noise.quantised import rounding_correlation
from allanscope.samples import unit_of

if TYPE_CHECKING:
    from allanscope.explain.effects import EffectKind

__all__ = ["Clock", "View"]

_TEXTBOOK = (White(1.0), Flicker(1.0), RandomWalk(1.0))
"""N, B and K, with sizes that the fit replaces."""

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Number = TypeVar("Number", float, Array)
Span = tuple[float, float]
"""From and until when, in s."""

_LEAST_KEPT = 0.1
"""Share of the ordinates that must stay in the fit: of none, no noise can be told."""
_NOTHING = 1e-9
"""Part of the range of the data that is rounding."""
_MANY = 400
"""Ordinates in a bin whose mean is known to a few per cent."""
_TRUSTED = 0.9
"""Below this part of q^2/12 the rounding is not white noise of its own."""
_OF_THE_DATA = ("ordinates", "squares", "of_data")
"""What a view computes that depends on nothing but its data."""
_HELD = 0.1
"""Share of repeated rows from which the rounding is as little white as what they repeat."""


@dataclass(frozen=True, slots=True)
class Clock:
    """Nominal rate, and the rate measured against a better clock with its standard error."""

    nominal_hz: float
    measured_hz: float
    error_hz: float


@dataclass(frozen=True)
class View:
    """One axis as it stands between two steps of the loop.

    Attributes
    ----------
    series : Series
        All axes.
    axis : str
        The axis in question.
    data : ndarray, shape (n,)
        Its samples without every deterministic effect accepted so far.
    accepted : tuple of Candidate
        What has been accepted.
    parts : tuple of Part
        Their stationary parts: processes and filters.
    excluded : tuple of (low, high)
        Frequencies in Hz that they leave out of the fit.
    step : float
        Distance of the values that occur (the LSB, or what a sender's rounding made of it).
    rounding : tuple of float
        Correlation of the rounding errors of samples 1, 2, ... apart; empty where they are white.
    stopped : str
        Why the search ended before it was done; empty when it was.
    path : tuple of SearchStep
        What was tried, what it gained, and which gate stopped it.
    """

    series: Series
    grid: Grid
    axis: str
    data: Array
    step: float
    rounding: tuple[float, ...] = ()
    accepted: tuple[Candidate, ...] = ()
    parts: tuple[Part, ...] = ()
    excluded: Ranges = ()
    clock: Clock | None = None
    base: tuple[Component, ...] = _TEXTBOOK
    stopped: str = ""
    path: tuple[SearchStep, ...] = ()

    @classmethod
    def of(
        cls, series: Series, axis: str, clock: Clock | None = None, step: float | None = None
    ) -> View:
        """Return an axis of which nothing is known but perhaps the step of its values."""
        column = series.column(axis)
        samples = np.ascontiguousarray(series.values[:, column])
        own = samples[~series.bridged]  # filling lies on no lattice
        if step is None:
            step = step_of(own * series.stride, series.lsb[column])  # of the sums behind the means
        rounding = rounding_correlation(own, step) if series.stride == 1 else ()
        return cls(series, series.grid, axis, samples, step, rounding, clock=clock)

    def untouched(self) -> View:
        """Return the axis as it was before anything was found."""
        samples = np.ascontiguousarray(self.samples)
        known = self.step, self.rounding
        return View(self.series, self.grid, self.axis, samples, *known, clock=self.clock)

    @once
    def proposed(self) -> dict[type[EffectKind], tuple[Candidate, ...]]:
        """What kinds of effects have proposed (`EffectKind.proposed`)."""
        return {}

    @once
    def of_data(self) -> dict[type, Any]:
        """What is kept of the data, whatever the model is."""
        return {}

    @once
    def ordinates(self) -> Array:
        """DCT-II ordinates of the data without the mean, shape (n - 1,)."""
        if all(c.signal is None for c in self.accepted):
            return np.asarray(self.series.ordinates[self.series.column(self.axis)])
        return np.asarray(dct(self.data - self.data.mean(), norm="ortho")[1:])

    @once
    def squares(self) -> Array:
        """Squared ordinates."""
        return self.ordinates**2

    @once
    def power(self) -> Array:
        """Mean square of every bin."""
        return self.grid.binned(self.squares, self.excluded)[0]

    @property
    def floor(self) -> float:
        """Variance per row that the rounding to the step adds; none where a step holds no noise."""
        return self.step**2 / 12 / self.series.stride

    @once
    def spectrum(self) -> Spectrum:
        """The noise fitted to the data with the parts accepted so far."""
        return self.fitter.fit(self.power)

    @once
    def fitter(self) -> SpectrumFitter:
        """Fits the same noise to other powers."""
        return SpectrumFitter.of(self.grid, self.model, self.excluded)

    def spectrum_with(self, *parts: Part) -> Spectrum:
        """Return the noise fitted to the data with more parts beside it."""
        return self.fitter.plus(*parts).fit(self.power)

    def loglik_with(self, *parts: Part) -> float:
        """Return the log-likelihood of that."""
        start = self.spectrum.powers
        if len(parts) == 1 and isinstance(parts[0], Component) and parts[0].has_amplitude:
            return self.fitter.loglik_beside(parts[0], self.power, np.append(start, 0.0))
        if len(parts) == 1 and isinstance(parts[0], Filter) and self.fitter.is_bare:
            return self.fitter.loglik_behind(parts[0], self.power, start)
        fitter = self.fitter.plus(*parts)
        more = len(fitter.basis.columns) - len(start)
        return fitter.loglik(self.power, np.append(start, np.zeros(more)))

    @once
    def model(self) -> NoiseModel:
        """The noise that is fitted: textbook, rounding, and the parts accepted so far."""
        floor = self.fitted_floor
        step = float(np.sqrt(12 * floor * self.grid.stride))
        rounding = (Rounding(step, self.rounding),) if step > 0 else ()
        return NoiseModel((*self.base, *rounding), self.grid.dt).plus(*self.parts)

    @once
    def fitted_floor(self) -> float:
        """The rounding's variance, never more than the lowest level there is.

        Behind a low-pass the rounding is all that is left at the top; where the noise hardly
        leaves one code, it is less than q^2/12. Rows that are held hold their rounding as well: it
        is part of the white noise then.
        """
        held = [p for p in self.parts if isinstance(p, HeldSamples | HeldPattern)]
        if any(part.fraction > _HELD for part in held):
            return 0.0
        kept = self.grid.counts(self.excluded)  # a bin that is left out has no power
        power = self.power
        if self.rounding:
            unit = Rounding(1.0, self.rounding)
            shape = 12 * unit.spectrum(self.grid.centre, self.grid.dt, self.grid.stride)
            power = power / np.maximum(shape, _NOTHING)
        lowest = float(power[kept > _MANY].min(initial=np.inf))
        return self.floor if lowest > _TRUSTED * self.floor else 0.98 * lowest

    @once
    def innovations(self) -> Array:
        """The data whitened by the noise model, back in time, shape (n,): unit variance.

        What was cut out of the fit is left out here too: a modulated tone is no burst. So are the
        zeros of a filter.
        """
        kept = self.spectrum.outside_zeros
        white = self.ordinates / np.sqrt(self.spectrum.ordinates * max(kept.mean(), 1e-9))
        return in_time(white * kept)

    @once
    def whitened(self) -> Array:
        """Ordinates by the noise model, of unit variance; 0 where they are cut out of the fit."""
        return self.ordinates / np.sqrt(self.spectrum.ordinates) * self.spectrum.kept

    @once
    def scan(self) -> StepScan:
        """What steps and boxes of the level gain under the fitted noise, at every instant."""
        return StepScan(self.grid, self.ordinates, self.spectrum)

    def time_at(self, row: Number) -> Number:
        """Return the time of the run in s at which a row, or each of an array, begins."""
        return self.series.start_s + row / self.grid.rate_hz

    def row_at(self, time_s: Number) -> Number:
        """Return the row at a time of the run, which may have begun before the rows."""
        return (time_s - self.series.start_s) * self.grid.rate_hz

    def rows_within(self, spans: Iterable[Span], margin_s: float = 0.0) -> Flags:
        """Tell which rows are within stretches of time, or as near to one as a margin."""
        within = np.zeros(self.grid.n, bool)
        for first, last in spans:
            begin, stop = map(self.row_at, (first - margin_s, last + margin_s))
            within[max(0, round(begin)) : max(0, round(stop))] = True
        return within

    @property
    def samples(self) -> Array:
        """The axis as measured."""
        return np.asarray(self.series.values[:, self.series.column(self.axis)])

    @once
    def crowded_codes(self) -> tuple[CrowdedCode, ...]:
        """Values at which the samples collect."""
        return crowded_codes(self.samples[~self.series.bridged], self.step)

    @property
    def missing_codes(self) -> tuple[float, ...]:
        """Values between frequent ones that never occur; none is known of means of samples."""
        if self.series.stride > 1:
            return ()
        return missing_codes(self.samples[~self.series.bridged], self.step)

    @property
    def unit(self) -> str:
        """Unit of the axis."""
        return unit_of(self.axis)

    def unit_of(self, axis: str) -> str:
        """Return the unit of another axis."""
        return unit_of(axis)

    @once
    def shocks_taken(self) -> frozenset[int]:
        """Numbers of the shocks of the record that have been taken out of this axis."""
        removing = (c for c in self.accepted if c.effect.removes_rows)
        taken = [c.signal for c in removing if c.signal is not None]
        if not taken:
            return frozenset()
        return frozenset(
            k
            for k, one in enumerate(self.series.shocks)
            if any(signal[one.first : one.stop].any() for signal in taken)
        )

    def sources(self, axis: str) -> tuple[Source, ...]:
        """Return another axis as this one may follow it.

        A shock that was taken out of this axis is out of the other too. One that the other has
        alone either came along, too softly to be taken out, or it did not.
        """
        taken = self.shocks_taken
        own = frozenset(k for k, one in enumerate(self.series.shocks) if axis in one.axes)
        shocks = (taken,) if own <= taken else (taken, taken | own)
        return tuple(self.series.source(axis, some) for some in shocks)

    def changed(self, **changes: Any) -> View:
        """Return the view with other fields, and with what is known of data that stay as they are.

        Transforms are most of what a view costs, and most changes are of its model.
        """
        view = replace(self, **changes)
        if view.data is self.data:
            known = vars(self)
            vars(view).update({name: known[name] for name in _OF_THE_DATA if name in known})
        return view

    def relisted(self, accepted: Iterable[Candidate]) -> View:
        """Return the view with the same effects, in another order or with more known of them."""
        view = replace(self, accepted=tuple(accepted))
        vars(view).update(vars(self) | {"accepted": view.accepted})
        return view

    def with_parts(self, *parts: Part) -> View:
        """Return the view with more stationary parts, to be fitted anew."""
        return self.changed(parts=(*self.parts, *parts))

    def without_range(self, low: float, high: float) -> View:
        """Return the view with a range of frequencies left out of the fit."""
        return self.changed(excluded=(*self.excluded, (low, high)))

    def leaves_too_little(self, candidate: Candidate) -> bool:
        """Return whether next to nothing is left to fit once its ranges or its signal are out too.

        Where hardly a sample leaves one code, those few are all there is.
        """
        if candidate.signal is not None:
            left, there = np.ptp(self.data - candidate.signal), np.ptp(self.data)
            return bool(left <= _NOTHING * there)
        kept = self.grid.kept((*self.excluded, *candidate.excluded))
        return bool(candidate.excluded) and float(kept.mean()) < _LEAST_KEPT

    def accept(self, candidate: Candidate) -> View:
        """Return the view with one more effect."""
        candidate = candidate.finished()
        data = self.data if candidate.signal is None else self.data - candidate.signal
        grown = self.changed(
            data=data,
            parts=self.parts + candidate.parts,
            excluded=self.excluded + candidate.excluded,
            accepted=(*self.accepted, candidate),
        )
        if not candidate.changes_model:  # all that was computed still holds, but for proposals
            before = {k: v for k, v in self.proposed.items() if k.stage < candidate.effect.stage}
            vars(grown).update(vars(self) | {"proposed": before} | vars(grown))
        return grown

    def is_fitted_as(self, other: View, stage: int) -> bool:
        """Return whether nothing is different to what is settled in a stage, or before it."""
        own, others = (
            [c for c in view.accepted if c.effect.stage <= stage] for view in (self, other)
        )
        same = (self.data is other.data, self.parts == other.parts, self.excluded == other.excluded)
        return all(same) and len(own) == len(others) and all(map(operator.is_, own, others))

    def without(self, *candidates: Candidate) -> View:
        """Return the view without some of its effects."""
        data, parts, excluded = self.data, set[Part](), set[tuple[float, float]]()
        for candidate in candidates:
            parts.update(candidate.parts)
            excluded.update(candidate.excluded)
            if candidate.signal is not None:
                data = data + candidate.signal
        return self.changed(
            data=data,
            parts=tuple(p for p in self.parts if p not in parts),
            excluded=tuple(r for r in self.excluded if r not in excluded),
            accepted=tuple(c for c in self.accepted if all(c is not one for one in candidates)),
        )

    @property
    def drifts(self) -> bool:
        """Whether a slow drift without a name has been accepted."""
        return any(c.effect.is_unnamed_drift for c in self.accepted)

    def has(self, kind: str) -> bool:
        """Return whether an effect of this kind has been accepted."""
        return any(c.kind == kind for c in self.accepted)
