"""The closed loop on a record: all axes, merged, with the error before and after."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import product
from queue import SimpleQueue
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.fft import set_workers

from allanscope.allan import Deviation
from allanscope.clock import RateFit
from allanscope.explain.candidate import Candidate, HeldOut, effect_of
from allanscope.explain.effect import AxisExplanation, Effect, Parameter, ResidualError, failed
from allanscope.explain.effects.clock_error import clock_error_of
from allanscope.explain.effects.quantization import Quantization
from allanscope.explain.effects.ramp import Ramp
from allanscope.explain.gates import growth_remarks
from allanscope.explain.highband import above_the_rows
from allanscope.explain.known_effects import KnownEffects, known_of, signals_of
from allanscope.explain.moves.add_known_lines import KnownLines, lines_of_others
from allanscope.explain.moves.drop import refuse
from allanscope.explain.residual import error_of, same_ordinates, shares_of
from allanscope.explain.search import Budget, close_loop
from allanscope.explain.series import Series, observations, series_of, why_not_searched
from allanscope.explain.view import Clock, View
from allanscope.history import Record
from allanscope.noise import NoiseFit, NoiseModel, fit_noise
from allanscope.noise.components import AngleQuantization
from allanscope.noise.filters import HighPass
from allanscope.noise.fit import Known
from allanscope.noise.gap_bridging import bridge_gaps
from allanscope.noise.quantised import LEAST_NOISE, resolution_advice
from allanscope.quantities import duration, measured
from allanscope.spectrum import Density
from allanscope.worker_process import WorkerError, WorkerProcess

__all__ = ["Explanation", "explain"]

Array = NDArray[np.float64]
T = TypeVar("T")
A = TypeVar("A")

_NOTHING = ResidualError(*[float("nan")] * 5)
"""Of an axis that was not searched."""
_ACCEPTED_P = 0.01
"""Least p-value of the residual of an axis that counts as explained."""
_TOGETHER, _FEWEST_TELLING = 0.8, 4.0
"""Correlation of ordinates from which two axes go along with each other, and how many must hold the
power: of noise that is independent on both one pair in 1000 reaches it."""
_TOLERANCE = 1e-4
"""Relative difference that counts as equal even where both intervals are narrower."""


@dataclass(frozen=True)
class Explanation:
    """What the loop found on every axis, and the models to draw.

    Attributes
    ----------
    axes : mapping
        Axis name to `AxisExplanation`. Of an axis on which the search failed it holds the error.
    models_before, models_after : mapping
        Axis name to the textbook model, and to the final one. An axis that could not be searched
        is missing.
    fits : mapping
        Axis name to the fit of the final model, whose coefficients are those that are published.
    cleaned : mapping
        Axis name to the samples without the deterministic effects, shape (n,).
    signals : mapping
        Axis name to what was taken out of its samples: kind of effect to its sum, shape (n,).
    row_s : float
        Time between those samples.
    held : KnownEffects
        What was accepted, for a fit of the noise beside it on a longer record (`fit_beside`).
    length_s, samples : float, int
        Of the record that was searched.
    """

    axes: Mapping[str, AxisExplanation]
    models_before: Mapping[str, NoiseModel] = field(default_factory=dict)
    models_after: Mapping[str, NoiseModel] = field(default_factory=dict)
    fits: Mapping[str, NoiseFit] = field(default_factory=dict, repr=False)
    cleaned: Mapping[str, Array] = field(default_factory=dict, repr=False)
    signals: Mapping[str, Mapping[str, Array]] = field(default_factory=dict, repr=False)
    row_s: float = 0.0
    held: KnownEffects = field(default_factory=KnownEffects, repr=False)
    length_s: float = 0.0
    samples: int = 0

    def with_rate(
        self, nominal_hz: float | None, rate_fit: RateFit | tuple[float, float] | None
    ) -> Explanation:
        """Return it with the error of the clock, where one was found, as it is known by now."""
        clock = _clock(nominal_hz, rate_fit)
        found = None if clock is None else clock_error_of(clock, tuple(self.axes))
        if found is None:
            return self

        def renewed(effect: Effect) -> Effect:
            return (effect_of(found, "") or effect) if effect.kind == found.kind else effect

        axes = {
            name: replace(one, effects=tuple(renewed(effect) for effect in one.effects))
            for name, one in self.axes.items()
        }
        return replace(self, axes=axes)


def explain(
    record: Record,
    densities: Mapping[str, Density] | None = None,
    *,
    nominal_hz: float | None = None,
    rate_fit: RateFit | tuple[float, float] | None = None,
    budget: Budget | None = None,
    workers: Sequence[WorkerProcess] = (),
) -> Explanation:
    """Close the loop on every axis of a record.

    Parameters
    ----------
    record : Record
        Rows of all axes in dps and g.
    densities : mapping of str to Density, optional
        Density of each axis; used above the rows' Nyquist frequency when they are block means.
    nominal_hz : float, optional
        Sample rate that the device claims.
    rate_fit : RateFit or (float, float), optional
        Sample rate measured against a better clock, and its standard error, in Hz.
    budget : Budget, optional
        How far to go.
    workers : sequence of WorkerProcess
        Processes that take an axis each, while this one has another: the result does not depend on
        them.

    Returns
    -------
    Explanation

    Raises
    ------
    ValueError
        If the record is empty or holds values that are not finite.
    """
    samples = len(record.values) * record.stride
    record = bridge_gaps(record)
    series = series_of(record)
    clock = _clock(nominal_hz, rate_fit)
    stopped = {axis: why_not_searched(series, axis) for axis in series.axes}
    open_axes = [axis for axis in series.axes if not stopped[axis]]
    if open_axes:
        # Shared by all axes, so computed before; an axis that fails on it will say so.
        with set_workers(1 + len(workers)), suppress(Exception):
            _ = series.thermal, series.equal, series.loud, series.shocks, series.deviation
    job = _Job(record, series, densities or {}, clock, budget)
    failures: dict[str, Exception] = {}
    with _Places(job, workers) as places:
        views = places.each(_searched, {axis: axis for axis in open_axes}, failures)
        views |= places.each(_with_known_lines, lines_of_others(views), failures)
        views = _merged(views)
        parts = places.each(_explained, views, failures)
    axes = {
        axis: parts[axis].explanation
        if axis in parts
        else failed(failures[axis])
        if axis in failures
        else _unsearched(series, axis, stopped[axis])
        for axis in series.axes
    }
    return Explanation(
        axes=axes,
        models_before={axis: p.before for axis, p in parts.items()},
        models_after={axis: p.after for axis, p in parts.items()},
        fits={axis: p.fit for axis, p in parts.items() if p.fit is not None},
        cleaned={axis: p.view.data for axis, p in parts.items()},
        signals={axis: signals_of(p.view) for axis, p in parts.items()},
        row_s=1.0 / series.rate_hz,
        held=_held(series, {axis: p.view for axis, p in parts.items()}),
        length_s=len(record.values) / record.rate_hz,
        samples=samples,
    )


@dataclass(frozen=True, eq=False)
class _Job:
    """What is known to everyone who works on an axis."""

    record: Record
    series: Series
    densities: Mapping[str, Density]
    clock: Clock | None
    budget: Budget | None


class _Places:
    """Where axes are worked on: a thread of this process, and others that wait for workers."""

    def __init__(self, job: _Job, workers: Sequence[WorkerProcess]) -> None:
        self._job = job
        self._free: SimpleQueue[WorkerProcess | None] = SimpleQueue()
        for place in (None, *workers):
            self._free.put(place)
        for worker in workers:  # before anybody computes: what is pickled must not change meanwhile
            worker.share(job, job.record, job.series, job.series.grid)
        self._pool = ThreadPoolExecutor(1 + len(workers))

    def each(
        self,
        work: Callable[[_Job, A], T],
        given: Mapping[str, A],
        failures: dict[str, Exception],
    ) -> dict[str, T]:
        """Do the same for several axes; one that fails is noted, and the others go on."""

        def guarded(axis: str) -> T | None:
            worker = self._free.get()
            try:
                if worker is not None:
                    try:
                        return worker.call(work, self._job, given[axis])
                    except WorkerError:  # killed, or no memory for it: it is done here
                        worker = None
                return work(self._job, given[axis])
            except Exception as error:
                failures[axis] = error
                return None
            finally:
                self._free.put(worker)

        done = dict(zip(given, self._pool.map(guarded, given), strict=True))
        return {axis: found for axis, found in done.items() if found is not None}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown()


def _searched(job: _Job, axis: str) -> View:
    """Return an axis with what was found on it."""
    view = close_loop(View.of(job.series, axis, job.clock), job.budget)
    if axis in job.densities and job.series.stride > 1:
        view = above_the_rows(view, job.densities[axis])
    return replace(view)  # without what it has computed on the way, most of which is not wanted


def _with_known_lines(job: _Job, known: KnownLines) -> View:
    """Return an axis with the lines of others that it has too."""
    budget = job.budget or Budget()
    return replace(known.added(budget.effects, budget.spent_nats))


def _held(series: Series, views: Mapping[str, View]) -> KnownEffects:
    """Return what holds for a longer record of the same run."""
    return KnownEffects(
        accepted={axis: view.accepted for axis, view in views.items()},
        steps={axis: view.step for axis, view in views.items()},
        stride=series.stride,
        rate_hz=series.rate_hz,
        start_s=series.start_s,
    )


def _clock(
    nominal_hz: float | None, rate_fit: RateFit | tuple[float, float] | None
) -> Clock | None:
    if isinstance(rate_fit, RateFit):
        if not rate_fit.is_measured:
            return None
        nominal_hz = nominal_hz or rate_fit.nominal_hz
        rate_fit = (rate_fit.hz, rate_fit.hz * rate_fit.uncertainty_ppm * 1e-6)
    if rate_fit is None or not nominal_hz:
        return None
    return Clock(nominal_hz, float(rate_fit[0]), float(rate_fit[1]))


@dataclass(frozen=True)
class _Closed:
    """One axis at the end of its search."""

    explanation: AxisExplanation
    before: NoiseModel
    after: NoiseModel
    fit: NoiseFit | None
    view: View


def _explained(job: _Job, view: View) -> _Closed:
    """Return an axis with the error before and after, and its shares."""
    record, density = job.record, job.densities.get(view.axis)
    series, axis = view.series, view.axis
    bare = view.untouched()
    # Where nothing was found, Q was not either: the two models then differ by no term.
    is_found = any(c.changes_model for c in view.accepted)
    terms = (AngleQuantization(1.0),) if is_found else ()
    before = _fit(record, axis, density, Known(terms, is_textbook=True))
    if before is not None:
        before_model, plain = before.model, bare
    else:
        textbook = _textbook(bare)
        before_model, plain = textbook.spectrum.model, replace(textbook, data=bare.data)
    measured = series.deviation.axis(series.column(axis))
    final = partial(_final, record, density, measured)
    after, after_model, error_after = final(view)
    evidence = same_ordinates(before, after) if before and after else ()
    error_before = error_of(plain, before_model, before, evidence, measured)
    kept = refuse(view, error_before, error_after, lambda one: final(one)[2])
    if kept is not view:
        view = kept
        after, after_model, error_after = final(view)
    shares, parts = None, (math.nan,) * len(view.accepted)
    if before is not None and after is not None:
        shares, parts = shares_of(view, before, after)
    effects = tuple(
        effect
        for c, part in zip(view.accepted, parts, strict=True)
        if (effect := effect_of(c, axis, part)) is not None
    )
    named = [c for c in view.accepted if c.effect.is_named and not c.effect.is_coefficient]
    held = [c.held_out for c in named if c.held_out is not None]
    clean = all(c.effect.is_named for c in view.accepted)
    explained = clean and not error_after.p_value < _ACCEPTED_P and not view.stopped
    explanation = AxisExplanation(
        effects=effects,
        before=error_before,
        after=error_after,
        coefficients_before=before.coefficients if before else {},
        coefficients_after=after.coefficients if after else {},
        held_out_nats=float(sum(h.nats for h in held)),
        held_out_nats_se=float(np.sqrt(sum(h.error**2 for h in held))),
        explained=bool(explained),
        path=view.path,
        shares=shares,
        remarks=observations(series, axis)
        + _missing(bare)
        + _too_coarse(view, after)
        + ((view.stopped,) if view.stopped else ())
        + growth_remarks(error_before, error_after)
        + _detection_limits(view),
    )
    return _Closed(explanation, before_model, after_model, after, replace(view))


def _final(
    record: Record, density: Density | None, measured: Deviation, view: View
) -> tuple[NoiseFit | None, NoiseModel, ResidualError]:
    """Fit the final model of a view, and compare the data, whose curve is known, with it."""
    fit = _fit(record, view.axis, density, known_of(view))
    model = fit.model if fit else view.spectrum.model
    for c in view.accepted:
        if c.effect.is_coefficient and c.signal is not None:  # it has been subtracted
            model = model.without(*c.effect.parameters)
    untouched = all(c.signal is None for c in view.accepted)
    return fit, model, error_of(view, model, fit, curve=measured if untouched else None)


def _fit(record: Record, axis: str, density: Density | None, known: Known) -> NoiseFit | None:
    """Fit the noise beside what is known; None where no stretch of the record is long enough."""
    try:
        return fit_noise(record, axis, density, known=known)
    except ValueError:
        return None


def _textbook(view: View) -> View:
    """Fit Q, N, B, K and, where it is significant, R: what everyone fits, to all there is."""
    view = replace(view, base=(*view.base, AngleQuantization(1.0)))
    for ramp in Ramp.candidates(view):
        if ramp.excess > 0:
            view = view.accept(ramp)
    return view


def _unsearched(series: Series, axis: str, why: tuple[str, ...]) -> AxisExplanation:
    nothing: dict[str, Any] = {}
    return AxisExplanation(
        effects=(),
        before=_NOTHING,
        after=_NOTHING,
        coefficients_before=nothing,
        coefficients_after=nothing,
        held_out_nats=0.0,
        held_out_nats_se=0.0,
        explained=False,
        remarks=why + series.remarks,
        hindrance=why[0],
    )


def _merged(views: Mapping[str, View]) -> dict[str, View]:
    """Return the views with the axes of every effect filled in.

    A line of one frequency, a step of one instant, a warm-up of one time constant: where the
    intervals of two axes overlap in what the effect is shared by, each names the other, and for
    what happens once in a record a second axis is the replication that time cannot give. Power
    without a name is one disturbance on the axes that go along with each other in it.
    """
    out = {}
    for axis, view in views.items():
        accepted = tuple(_with_axes(candidate, axis, views) for candidate in view.accepted)
        out[axis] = replace(view, accepted=accepted)
    return out


def _with_axes(candidate: Candidate, axis: str, views: Mapping[str, View]) -> Candidate:
    key = candidate.effect.shared_by
    is_nameless = not candidate.effect.is_named and candidate.signal is None
    if not key and not (is_nameless and candidate.excluded):
        return candidate

    def is_one(other: Candidate, beside: View) -> bool:
        if key:
            return _same(candidate, other, key) and candidate.effect.goes_along(other.effect)
        return _go_along(views[axis], candidate, other, beside)

    axes = tuple(
        other
        for other, view in views.items()
        if other == axis or any(c.kind == candidate.kind and is_one(c, view) for c in view.accepted)
    )
    held = candidate.held_out
    if len(axes) > 1 and held is not None and held.replicated is None:
        held = HeldOut(held.nats, held.error, f"{held.design}; seen on {len(axes)} axes", True)
    return replace(candidate, axes=axes, held_out=held)


def _same(first: Candidate, second: Candidate, key: str) -> bool:
    """Return whether two effects agree in what one of a kind has on all axes."""
    a, b = first.effect.parameters[key], second.effect.parameters[key]
    (a_low, a_high), (b_low, b_high) = _limits(a), _limits(b)
    return a_low <= b_high and b_low <= a_high


def _go_along(view: View, own: Candidate, other: Candidate, beside: View) -> bool:
    """Return whether two axes follow each other in the ranges that both have without a name."""
    pairs = product(own.excluded, other.excluded)
    both = tuple((max(a, c), min(b, d)) for (a, b), (c, d) in pairs if max(a, c) <= min(b, d))
    if other.signal is not None or not both:  # as most: nothing is asked of a million ordinates
        return False
    inside = ~view.grid.kept(both)
    x, y = view.ordinates[inside], beside.ordinates[inside]
    is_told = min(map(_telling, (x, y))) >= _FEWEST_TELLING
    return is_told and abs(float(x @ y)) > _TOGETHER * float(np.sqrt((x @ x) * (y @ y)))


def _telling(ordinates: Array) -> float:
    """Return how many of some ordinates hold most of their power; a third of them all in noise."""
    squares = ordinates**2
    return float(squares.sum() ** 2 / max(float(squares @ squares), 1e-300))


def _limits(parameter: Parameter) -> tuple[float, float]:
    assert isinstance(parameter.value, float)
    room = _TOLERANCE * abs(parameter.value)
    low = parameter.value if parameter.lower is None else parameter.lower
    high = parameter.value if parameter.upper is None else parameter.upper
    return min(low, parameter.value - room), max(high, parameter.value + room)


def _too_coarse(view: View, fit: NoiseFit | None) -> tuple[str, ...]:
    """Say so where a step that only the values give away hides the noise.

    Numbers that were printed to some digits are on a finer lattice than the sensor's, by which the
    fit does not see it.
    """
    coarse = (c.effect for c in view.accepted if isinstance(c.effect, Quantization))
    hidden = any(one.noise_in_steps < LEAST_NOISE for one in coarse)
    if not hidden or (fit is not None and fit.step_limited):
        return ()
    return (resolution_advice(view.unit, view.step),)


def _missing(view: View) -> tuple[str, ...]:
    """Return which codes never occur; those beside them then hold more than their share."""
    return tuple(
        f"no sample is {value:.6g} {view.unit}, though the values beside it are frequent: a "
        "missing code of the converter, or of a rounding after it"
        for value in view.missing_codes
    )


def _detection_limits(view: View) -> tuple[str, ...]:
    """Return what could have hidden: the smallest line and step that would be detected."""
    spectrum = view.spectrum
    n = view.grid.n
    top = float(spectrum.at(np.array([view.grid.rate_hz / 8]))[0])
    line = np.sqrt(4 * top / n * (np.log(0.75 * n / 1e-3) + 2))
    step = 6.3 / np.sqrt(np.sum(_of_a_step(n, view.grid.low) / spectrum.first(view.grid.low)))
    limits = (
        f"detection limits in {duration(view.series.duration_s)}: line "
        f"{measured(line, unit=view.unit)} (at {view.grid.rate_hz / 8:.3g} Hz)"
    )
    high_pass = next((one for one in view.parts if isinstance(one, HighPass)), None)
    if high_pass is not None:
        return (
            f"{limits}; a step, a drift, and B and K below {high_pass.corner:.2g} Hz do not pass "
            "the high-pass: B and K are those of the filtered values",
        )
    return (f"{limits}, step {measured(step, unit=view.unit)}",)


@lru_cache(maxsize=2)  # all axes of a record have as many
def _of_a_step(n: int, ordinates: int) -> Array:
    """Return the squares of the first ordinates of n rows that go one up in the middle."""
    k = np.arange(1, ordinates + 1)
    return np.asarray(np.sin(np.pi * k / 2) ** 2 / (2 * np.sin(np.pi * k / (2 * n))) ** 2 * 2 / n)
