"""From running sums to a result: curves, noise, verdicts, and what the model does not explain."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from allanscope.allan import Deviation, DynamicDeviation
from allanscope.analysis.analyser import (
    FEWEST_ROWS,
    Analyser,
    AnalyserSettings,
    LoopInput,
    StreamState,
    loop_input,
)
from allanscope.analysis.coefficients import published_coefficients
from allanscope.analysis.coherence import common_of
from allanscope.analysis.comparison import ReferenceCurve, compare_curve
from allanscope.analysis.curve_limits import limited_by_curve
from allanscope.analysis.curves import curves_of_bank, curves_of_samples
from allanscope.analysis.datasheet import compare, rms_of
from allanscope.analysis.disagreement import disagreement
from allanscope.analysis.findings import line_of
from allanscope.analysis.line_origin import clock_wander_of
from allanscope.analysis.model_curves import draw_models
from allanscope.analysis.motion import motion_remark
from allanscope.analysis.readings import density_of, read_axis, tells_flat
from allanscope.analysis.remarks import (
    axis_remarks,
    run_remarks,
    sampling_remarks,
    scale_remarks,
)
from allanscope.analysis.result import Analysis, AsOf, AxisAnalysis, Level, Rate
from allanscope.analysis.tracing import Trace, trace_findings
from allanscope.analysis.undisturbed import undisturbed
from allanscope.explain import failed, failure_text
from allanscope.history import Record
from allanscope.noise import (
    Coefficient,
    DatasheetVerdict,
    NoiseFit,
    find_best_averaging,
    fit_noise,
    power_laws_of,
)
from allanscope.parts import PARTS, full_scale_of
from allanscope.samples import unit_of
from allanscope.spectrum import Density
from allanscope.wire import LinkStats
from allanscope.worker_process import SEARCH, WorkerError, WorkerProcess

if TYPE_CHECKING:
    from allanscope.explain import Explanation

__all__ = ["Depth", "search_processes", "summarise", "with_comparison"]

Depth = Literal["live", "full"]
"""``live`` is what a refresh can afford; ``full`` runs every estimator and closes the loop."""

LIVE_ROWS = 1 << 15
"""Rows that a refresh fits the noise to before the first search; the density knows what is above
them, as in every long run."""

WORTH_A_PROCESS = 30_000
"""Values of a record, all axes, whose search takes longer than a process to start."""

FEW_PROCESSES = 3_000_000
"""Values from which no more than two processes search: each may take some hundred megabytes."""

TENTHS = 10

POLLED_PART = "LSM6DSM"
"""The sensor of the board for which there is firmware that reads it by a timer."""


def summarise(
    analyser: Analyser,
    link: LinkStats,
    depth: Depth,
    input_facts: Mapping[str, str],
    reconnects: int = 0,
    known: Explanation | None = None,
    workers: Sequence[WorkerProcess] = (),
) -> Analysis:
    """Return the result of what an analyser has taken.

    Parameters
    ----------
    analyser : Analyser
        The sums; buffered rows are added, nothing else is changed.
    link : LinkStats
        Counters of the decoder.
    depth : {'live', 'full'}
        How much to compute.
    input_facts : mapping
        Where the samples came from.
    reconnects : int
        Times that the port came back.
    known : Explanation, optional
        What the last look at the run found; with depth ``full`` the loop is closed anew.
    workers : sequence of WorkerProcess
        Those of `search_processes`; with depth ``full``, what is missing is started, and ended.
    """
    settings = analyser.settings
    if not analyser.configurations:
        return _empty(analyser, link, input_facts, reconnects)
    state = max(analyser.configurations, key=lambda one: one.samples)
    state.settle()
    rate = _rate(state)
    rate_hz = rate.best_hz or 1.0
    given = loop_input(state)
    if depth == "live" and known is None:
        given = replace(given, record=given.record.coarsened(LIVE_ROWS))
    axes, loop = _axes(state, given, rate, depth, settings, known, workers)
    part = settings.part or state.info.part
    offered = PARTS[part or POLLED_PART].rates_hz if state.info.polled else ()
    events = state.watch.events(rate_hz)
    quiet = None
    if depth == "full":
        quiet = undisturbed(events, given.record, PARTS.get(part), loop)
    found = Analysis(
        input={**input_facts, **_full_scales(given.record, settings)},
        part=part,
        duration_s=state.samples / rate_hz,
        samples=state.samples,
        lost_samples=state.lost,
        segments=state.segments,
        rate=rate,
        link=replace(link),
        axes=axes,
        reconnects=reconnects,
        unknown_losses=state.unknown_losses,
        temperature=state.temperature.summary(),
        marks=_marks(analyser, state, rate_hz),
        events=events,
        undisturbed=quiet,
        assumptions=tuple(analyser.assumptions),
        remarks=(
            *filter(None, [motion_remark(given.record)]),
            *run_remarks(analyser, state, rate),
            *_scale_remarks(state, given.record, part),
            *sampling_remarks(axes, _claimed(state, rate), offered),
        ),
        version=version("allanscope"),
        dynamic=_dynamic(state, rate_hz),
        record=given.record if depth == "full" else None,
        origin=state.info.origin,
        choices=settings.curves,
    )
    found = with_comparison(found, settings.references)
    if depth != "full":
        return found
    found = replace(found, traces=_traces(found, state, given))
    common = common_of(given.record, found.findings, threads=settings.processes)
    return replace(found, common=common)


def _dynamic(state: StreamState, rate_hz: float) -> DynamicDeviation | None:
    """Return the Allan deviation over time; None where there are no windows yet, or none kept."""
    if not state.bank.keeps_windows:
        return None
    state.bank.scale = np.asarray(state.info.scale)
    found = state.bank.dynamic(rate_hz)
    return found if found.deviation.size else None


def with_comparison(analysis: Analysis, references: Mapping[str, ReferenceCurve]) -> Analysis:
    """Return the result with each axis compared with its reference, as far as it has one."""
    axes = {
        axis: replace(one, comparison=compare_curve(one.curves["oadev"], references[axis]))
        if axis in references and "oadev" in one.curves
        else one
        for axis, one in analysis.axes.items()
    }
    name = next((one.name for one in references.values()), "")
    return replace(analysis, axes=axes, reference=name)


def _traces(found: Analysis, state: StreamState, given: LoopInput) -> dict[tuple[str, int], Trace]:
    """Return what the findings come from; the other results do not depend on it."""
    has_line = any(line_of(one.members[0].effect) for one in found.findings)
    return trace_findings(
        found.findings,
        given.record,
        clock_wander_of(state.clock.arrivals()) if has_line else None,
        rate_ppm=found.rate.uncertainty_ppm,
        part=found.part,
        is_whole=not state.unknown_losses,
        effects={k: a.explanation.effects for k, a in found.axes.items() if a.explanation},
    )


def _full_scale(settings: AnalyserSettings, axis: str, lsb: float) -> float | None:
    """Return the full scale that was named, or to which the step of the values belongs."""
    return settings.full_scales.get(unit_of(axis)) or full_scale_of(axis, lsb)


def _full_scales(record: Record, settings: AnalyserSettings) -> dict[str, str]:
    """Return the full scales of the sensors; nothing where none is known."""
    scales = {
        f"{full_scale:g} {unit_of(axis)}": None
        for axis, lsb in zip(record.axes, record.lsb, strict=True)
        if (full_scale := _full_scale(settings, axis, lsb)) is not None
    }
    return {"full_scales": ", ".join(scales)} if scales else {}


def _claimed(state: StreamState, rate: Rate) -> Rate:
    """Return the rate as it may be compared: a rate read off the times is no setting."""
    return rate if state.info.rate_claimed else replace(rate, nominal_hz=0.0)


def _empty(
    analyser: Analyser, link: LinkStats, input_facts: Mapping[str, str], reconnects: int
) -> Analysis:
    return Analysis(
        input=dict(input_facts),
        part=analyser.settings.part,
        duration_s=0.0,
        samples=0,
        lost_samples=0,
        segments=0,
        rate=Rate(0.0),
        link=replace(link),
        axes={},
        reconnects=reconnects,
        version=version("allanscope"),
    )


def _marks(analyser: Analyser, state: StreamState, rate_hz: float) -> tuple[tuple[float, str], ...]:
    """Return when marks were set: on the axis of the series, at the true rate, gaps included."""
    same = (0.0, state.info.nominal_hz)
    return tuple(
        (mark.position / (rate_hz if mark.nominal_hz in same else mark.nominal_hz), mark.text)
        for mark in analyser.marks
    )


def _rate(state: StreamState) -> Rate:
    fit = state.clock.rate()
    device_clock = state.info.details.get("clock")
    if not fit.is_measured:
        return Rate(state.info.nominal_hz, device_clock=device_clock)
    against_host = fit.device_against_host
    return Rate(
        state.info.nominal_hz,
        fit.hz,
        fit.uncertainty_ppm,
        source=fit.source,
        residual_s=fit.residual_s,
        span_s=fit.span_s,
        steps=fit.steps,
        drift_ppm_per_h=fit.drift_ppm_per_h,
        drift_uncertainty_ppm_per_h=fit.drift_uncertainty_ppm_per_h,
        ppm_per_degc=fit.ppm_per_degc,
        ppm_per_degc_uncertainty=fit.ppm_per_degc_uncertainty,
        device_against_host_ppm=None if against_host is None else 1e6 * against_host,
        device_clock=device_clock,
    )


def _axes(
    state: StreamState,
    given: LoopInput,
    rate: Rate,
    depth: Depth,
    settings: AnalyserSettings,
    known: Explanation | None,
    ready: Sequence[WorkerProcess],
) -> tuple[dict[str, AxisAnalysis], Explanation | None]:
    """Return everything about every axis, and what the search found."""
    rate_hz = rate.best_hz or 1.0
    part = settings.part or state.info.part
    as_of = AsOf(state.samples / rate_hz, state.samples)
    processes = settings.processes if depth == "full" else 1
    choices, record = settings.curves, given.record
    asked = state.info, state.bank, record, rate_hz, settings.level, choices, depth == "live"
    with (
        _workers(given, processes, ready) as workers,  # new ones load now
        ThreadPoolExecutor(1) as beside,
    ):
        if depth == "live":
            curves, loop = curves_of_bank(*asked), known
        elif choices.needs_samples:
            curves = curves_of_samples(state, rate_hz, settings.level, choices)
            loop = _loop(given, workers)
        elif workers:
            coming = beside.submit(lambda: workers[0].call(curves_of_bank, *asked))
            loop = _loop(given, workers)
            try:
                curves = coming.result()
            except WorkerError:  # it has ended
                curves = curves_of_bank(*asked)
        else:
            curves, loop = curves_of_bank(*asked), _loop(given, workers)
    if loop is not None and depth == "live":
        loop = loop.with_rate(given.nominal_hz, given.rate_fit)
        try:
            loop = _with_noise_of_now(loop, given)
        except Exception:  # the last search stands, and says of when it is
            as_of = AsOf(loop.length_s, loop.samples)
    axes = {
        name: _axis_or_failure(
            state,
            given.record,
            name,
            curves=curves[name],
            density=given.densities[name],
            loop=loop,
            rate=rate,
            part=part,
            as_of=as_of,
            power_laws=settings.curves.power_laws if depth == "full" else "",
            full_scale=_full_scale(settings, name, lsb),
        )
        for name, lsb in zip(given.record.axes, given.record.lsb, strict=True)
    }
    return axes, loop


def _axis_or_failure(
    state: StreamState, record: Record, name: str, *, curves: dict[str, Deviation], **known: Any
) -> AxisAnalysis:
    """Return everything about one axis; what fails there must not take the others along."""
    loop: Explanation | None = known["loop"]
    explanation = loop.axes.get(name) if loop else None
    try:
        axis = _axis(state, record, name, curves=curves, **known)
        failure = explanation.failure if explanation is not None else ""
    except Exception as error:
        failure = failure_text(error)
        axis = AxisAnalysis(
            unit_of(name), curves, explanation=failed(error), density=known["density"]
        )
    if not failure:
        return axis
    remark = f"the analysis of this axis failed ({failure}); please report it"
    return replace(axis, failure=failure, remarks=(remark, *axis.remarks))


def _with_noise_of_now(loop: Explanation, given: LoopInput) -> Explanation:
    """Return what the last search found with the noise of this moment, the effects held."""
    from allanscope.explain import fit_beside

    beside = fit_beside(loop.held, given.record, given.densities)
    return replace(
        loop,
        models_before={k: v for k, v in loop.models_before.items() if k in beside},
        models_after={k: one.fit.model for k, one in beside.items()},
        fits={k: one.fit for k, one in beside.items()},
        signals={k: one.signals for k, one in beside.items()},
        row_s=next((one.row_s for one in beside.values()), loop.row_s),
    )


def search_processes(analyser: Analyser, preload: str = "") -> list[WorkerProcess]:
    """Start the processes that search beside this one, for a full result that is soon wanted.

    They take a second to load. The caller ends them.

    Parameters
    ----------
    analyser : Analyser
        What is to be summarised.
    preload : str
        Module that the first one loads as well, for what it is asked after the search.
    """
    state = analyser.state
    if state is None:
        return []
    for module in SEARCH.split():  # this process searches as well
        import_module(module)
    axes = len(state.info.axes)
    most = min(_most_processes(axes * state.samples, analyser.settings.processes), axes)
    return [WorkerProcess(" ".join([SEARCH, preload][: 1 + (k == 0)])) for k in range(most - 1)]


def _most_processes(values: int, processes: int) -> int:
    return min(processes, 2) if values > FEW_PROCESSES else processes


@contextmanager
def _workers(
    given: LoopInput, processes: int, ready: Sequence[WorkerProcess]
) -> Iterator[list[WorkerProcess]]:
    """Start the processes that a search is worth beside this one and those ready; end them."""
    values = given.record.values
    if values.size < WORTH_A_PROCESS:
        processes = 1
    most = min(_most_processes(values.size, processes), values.shape[1]) - 1
    with ExitStack() as stack:
        new = range(most - len(ready))
        yield [*ready, *(stack.enter_context(WorkerProcess(SEARCH)) for _ in new)]


def _loop(given: LoopInput, workers: Sequence[WorkerProcess]) -> Explanation | None:
    if len(given.record.values) < FEWEST_ROWS:
        return None
    from allanscope.explain import Explanation, explain  # the search: a start does not wait for it

    try:
        return explain(
            given.record,
            given.densities,
            nominal_hz=given.nominal_hz,
            rate_fit=given.rate_fit,
            workers=workers,
        )
    except Exception as error:  # curves and noise are known all the same
        return Explanation({axis: failed(error) for axis in given.record.axes})


def _axis(
    state: StreamState,
    record: Record,
    name: str,
    *,
    curves: dict[str, Deviation],
    density: Density,
    loop: Explanation | None,
    rate: Rate,
    part: str,
    as_of: AsOf,
    power_laws: str,
    full_scale: float | None,
) -> AxisAnalysis:
    column = state.info.axes.index(name)
    explanation = loop.axes.get(name) if loop else None
    fit = loop.fits.get(name) if loop else None
    if fit is None:
        fit = _fit(record, name, density, part)
    curve = curves.get("oadev")
    fits = {**(loop.fits if loop else {}), **({name: fit} if fit else {})}
    coefficients = published_coefficients(name, fits, loop.axes if loop else {})
    refuted: tuple[str, ...] = ()
    if fit is not None and curve is not None:
        coefficients, refuted = limited_by_curve(unit_of(name), coefficients, fit.model, curve)
    # Where gaps leave the stream no density, that of the bridged rows is read.
    measured = density if len(density.frequency) or fit is None else density_of(fit.evidence)
    readings = read_axis(measured, curve, unit_of(name))
    searched = AsOf(loop.length_s, loop.samples) if loop and explanation else None
    model = fit.model if fit else None
    own = fit.coefficients if fit else {}
    drawn = draw_models(name, loop, model, curve, density, rate.best_hz, own)
    apart = disagreement(
        unit_of(name),
        coefficients,
        readings,
        explanation.effects if explanation else (),
        fit.rounding if fit else 0.0,
        drawn.model,
        fit.bands if fit else None,
        tells_flat=tells_flat(measured),
    )
    return AxisAnalysis(
        unit=unit_of(name),
        curves=curves,
        level=_level(record, column, unit_of(name)),
        coefficients=coefficients,
        best_averaging=find_best_averaging(curve) if curve is not None else None,
        datasheet=_datasheet(
            full_scale,
            name,
            part,
            coefficients,
            rate,
            density,
            step_limited=fit is not None and fit.step_limited,
        ),
        density=density if len(density.frequency) else None,
        model=drawn.model,
        model_before=drawn.before,
        density_model=drawn.density,
        explanation=explanation,
        readings=readings,
        power_laws=_power_laws(record, name, power_laws, fit, loop),
        coefficients_as_of=as_of if coefficients else None,
        explanation_as_of=searched,
        remarks=(
            *axis_remarks(state, column),
            *(fit.remarks if fit else ()),
            *refuted,
            *((apart,) if apart else ()),
        ),
    )


def _power_laws(
    record: Record, name: str, letters: str, fit: NoiseFit | None, loop: Explanation | None
) -> dict[str, Coefficient]:
    if not letters or fit is None:
        return {}
    found = list(loop.signals.get(name, {}).values()) if loop else []
    # A search of a longer record looks at means of its rows.
    known = [signal for signal in found if len(signal) == len(record.values)]
    return power_laws_of(record, name, letters, fit, sum(known) if known else 0.0)


def _fit(record: Record, name: str, density: Density, part: str) -> NoiseFit | None:
    """Fit the noise of one axis; None where there is nothing to fit yet."""
    if len(record.values) < FEWEST_ROWS:
        return None
    try:
        return fit_noise(record, name, density, part=PARTS.get(part))
    except ValueError:  # constant, or in pieces too short: the remarks say which
        return None


def _scale_remarks(state: StreamState, record: Record, part: str) -> tuple[str, ...]:
    if state.counted or not part:
        return ()
    return scale_remarks(dict(zip(state.info.axes, record.lsb, strict=True)), part)


def _level(record: Record, column: int, unit: str) -> Level | None:
    values = record.values[:, column]
    if len(values) == 0:
        return None
    tenths = [part.mean() for part in np.array_split(values, TENTHS)] if len(values) >= 100 else []
    stability = float(np.std(tenths, ddof=1)) if tenths else None
    return Level(float(values.mean()), stability, unit)


def _datasheet(
    full_scale: float | None,
    name: str,
    part: str,
    coefficients: Mapping[str, Coefficient],
    rate: Rate,
    density: Density,
    *,
    step_limited: bool,
) -> dict[str, DatasheetVerdict]:
    if part not in PARTS:
        return {}
    return compare(
        PARTS[part],
        name,
        coefficients.get("N"),
        rate_hz=rate.best_hz,
        full_scale=full_scale,
        rms=rms_of(density),
        step_limited=step_limited,
    )
