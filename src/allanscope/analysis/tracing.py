"""What a finding is traced to: the source of a line, and the direction of lines and events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from allanscope.analysis.coherence import Leak, leak_of
from allanscope.analysis.direction import (
    Motion,
    motion_of_burst,
    motion_of_line,
    motion_of_step,
)
from allanscope.analysis.findings import Finding, event_times, line_of
from allanscope.analysis.line_origin import ClockWander, LineOrigin, origin_of, reduced
from allanscope.explain import Effect
from allanscope.history import Record
from allanscope.parts import PARTS

__all__ = ["Trace", "trace_findings"]


@dataclass(frozen=True, slots=True)
class Trace:
    """What is known of the cause of a finding.

    Attributes
    ----------
    origin : LineOrigin or None
        Of a line.
    motion : Motion or None
        Direction of a line, a step, an excursion or a burst.
    leak : Leak or None
        Direction of a cross-coupling that its noise alone does not tell.
    """

    origin: LineOrigin | None = None
    motion: Motion | None = None
    leak: Leak | None = None


def trace_findings(
    findings: Sequence[Finding],
    record: Record,
    wander: ClockWander | None,
    *,
    rate_ppm: float | None,
    part: str = "",
    is_whole: bool = True,
    effects: Mapping[str, Sequence[Effect]] | None = None,
) -> dict[tuple[str, int], Trace]:
    """Return the trace of each finding, by axis and index of its leading effect.

    Parameters
    ----------
    findings : sequence of Finding
        Of one run.
    record : Record
        Its rows.
    wander : ClockWander or None
        Of its clock.
    rate_ppm : float or None
        Standard error of the sample rate; None where it was not measured.
    part : str
        Name of the sensor, for its low-pass.
    is_whole : bool
        Whether the lengths of all gaps are known.
    effects : mapping, optional
        Axis to its effects, for the low-pass that was measured.
    """
    rate_hz = record.rate_hz * record.stride
    numbers = record.start_s * rate_hz + 0.5 * (record.stride - 1)
    moving = [k for k in range(len(record.axes)) if np.ptp(record.values[:, k]) > 0]
    axes = tuple(record.axes[k] for k in moving)
    values = record.values[:, moving]
    pieces = None
    if not is_whole:
        pieces = np.searchsorted(record.segments[:, 0], np.arange(len(values)), side="right")
    offered = PARTS[part].rates_hz if part in PARTS else ()

    def lines_on(coupled: Finding) -> dict[float, float]:
        here = [one for one in findings if set(one.axes) & set(coupled.axes)]
        known = [line_of(one.members[0].effect) for one in here]
        return {one[0]: max(one[2] - one[1], one[3]) for one in known if one is not None}

    known: dict[tuple[str, int], Trace] = {}
    for finding in findings:
        lead = finding.members[0]
        line = line_of(lead.effect)
        trace = Trace()
        if line is not None:
            found = [axes.index(axis) for axis in finding.axes if axis in axes]
            origin = origin_of(
                values[:, found],
                numbers,
                rate_hz,
                line[:3],
                wander,
                width_hz=line[3],
                rate_ppm=rate_ppm,
                cutoff_hz=_cutoff(lead.axis, rate_hz, part, (effects or {}).get(lead.axis, ())),
                pieces=pieces,
                offered_hz=offered,
                amplitude=_amplitude(lead.effect),
            )
            motion = _line_motion(values, axes, numbers, rate_hz, line, origin)
            trace = Trace(origin, motion)
        elif lead.effect.traits.motion == "shift":
            at = event_times(lead.effect)[0]
            trace = replace(trace, motion=motion_of_step(values, record.start_s, axes, at))
        elif lead.effect.traits.motion == "burst":
            start, stop = event_times(lead.effect)
            motion = motion_of_burst(values, record.start_s, axes, start, stop)
            trace = replace(trace, motion=motion)
        elif lead.effect.traits.is_coupling:
            trace = replace(trace, leak=leak_of(finding, lines_on(finding), record, rate_hz))
        if trace != Trace():
            known[lead.axis, lead.index] = trace
    return known


def _amplitude(effect: Effect) -> tuple[float, float, str] | None:
    known = effect.parameters.get("amplitude")
    if known is None or known.lower is None or known.upper is None:
        return None
    return known.lower, known.upper, known.unit


def _line_motion(
    values: NDArray[np.float64],
    axes: tuple[str, ...],
    numbers: NDArray[np.float64],
    rate_hz: float,
    line: tuple[float, float, float, float],
    origin: LineOrigin,
) -> Motion | None:
    seen, low, high, width = line
    sums = reduced(values, numbers, rate_hz, seen, max(high - low, width), None)
    if sums is None:
        return None
    # A line that drifts, or folds under a clock that does, keeps its phase for so long only.
    sections = int(np.clip(4 * width * len(values) / rate_hz, 16, sums.sums.shape[1] // 4))
    frequency = None if origin.source == "internal" else origin.frequency_hz or seen
    return motion_of_line(sums, axes, len(values), values.mean(axis=0), frequency, sections)


def _cutoff(axis: str, rate_hz: float, part: str, effects: Sequence[Effect]) -> float | None:
    """Return the low-pass of an axis: measured, else the only one that the part has."""
    for effect in effects:
        cutoff = effect.parameters.get("cutoff")
        if cutoff is not None:
            return float(cutoff.value)
    offered = PARTS[part].cutoffs_hz(axis, rate_hz) if part in PARTS else ()
    return offered[0] if len(offered) == 1 else None
