"""The result of a run: all that is known about every axis, as it is shown and written."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import CurveChoices, Deviation, DynamicDeviation
from allanscope.analysis.comparison import Comparison
from allanscope.analysis.experiments import Experiment, next_experiments
from allanscope.analysis.findings import Finding, findings_of
from allanscope.analysis.undisturbed import Undisturbed
from allanscope.explain import AxisExplanation, Effect, ResidualError
from allanscope.history import Record
from allanscope.noise import BestAveraging, Coefficient, DatasheetVerdict
from allanscope.samples import Origin
from allanscope.spectrum import Density
from allanscope.watch import Event
from allanscope.wire import LinkStats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from allanscope.analysis.coherence import CoherentBand
    from allanscope.analysis.tracing import Trace

__all__ = [
    "READINGS",
    "SCHEMA",
    "Analysis",
    "AsOf",
    "AxisAnalysis",
    "Level",
    "ModelCurve",
    "Rate",
    "Reading",
    "event_dict",
]

SCHEMA = "allanscope/1"

READINGS = ("N", "N_1s", "B", "K")
"""What can be read, in the order of tables."""


@dataclass(frozen=True, slots=True)
class Rate:
    """The sample rate: claimed, and measured against a clock.

    Attributes
    ----------
    nominal_hz : float
        What the device claims; 0 when it claims nothing.
    measured_hz, uncertainty_ppm : float or None
        Measured, and one standard deviation of it; None until known, as all that follows.
    source : {'host', 'device'} or None
        Whose clock it was measured with: the computer's, or the crystal of the device.
    residual_s, span_s : float or None
        Standard deviation of the arrivals about the line, and the time that they span.
    steps : int
        Times of lasting changes of the delay without a reported loss.
    drift_ppm_per_h, drift_uncertainty_ppm_per_h : float or None
        Change of the rate in an hour.
    ppm_per_degc, ppm_per_degc_uncertainty : float or None
        Change of the rate per degC, had all of it followed the temperature.
    device_against_host_ppm : float or None
        By how much the crystal of the device differs from the clock of the computer.
    device_clock : str or None
        What counts the time of the device, as it says itself: ``crystal``, ``RC oscillator``,
        ``emulated``, ``none``; None when it does not say.
    """

    nominal_hz: float
    measured_hz: float | None = None
    uncertainty_ppm: float | None = None
    source: str | None = None
    residual_s: float | None = None
    span_s: float | None = None
    steps: int = 0
    drift_ppm_per_h: float | None = None
    drift_uncertainty_ppm_per_h: float | None = None
    ppm_per_degc: float | None = None
    ppm_per_degc_uncertainty: float | None = None
    device_against_host_ppm: float | None = None
    device_clock: str | None = None

    @property
    def best_hz(self) -> float:
        """The measured rate where it is known, else the nominal one."""
        return self.nominal_hz if self.measured_hz is None else self.measured_hz


@dataclass(frozen=True, slots=True)
class Level:
    """Zero-rate or zero-g level: the mean of the axis, and how much it moved.

    `stability` is the standard deviation of the means over tenths of the run, None when the run is
    too short.
    """

    mean: float
    stability: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class AsOf:
    """How long the run was when something was computed: while it goes on it grows older.

    Attributes
    ----------
    time_s : float
        Length of the run in seconds.
    samples : int
        The same in samples of each axis.
    """

    time_s: float
    samples: int


@dataclass(frozen=True, slots=True)
class Reading:
    """A coefficient as it is read off a curve.

    Attributes
    ----------
    value : float
        In `unit`.
    lower, upper : float
        95 % interval; `lower` is 0 where the curve has not risen from its minimum, so that only the
        upper limit is known.
    unit : str
        E.g. ``dps/sqrt(Hz)``.
    tau_s : float or None
        Averaging time in s at which the deviation was read.
    band_hz : (float, float) or None
        Lowest and highest frequency in Hz between which the density was read.
    """

    value: float
    lower: float
    upper: float
    unit: str
    tau_s: float | None = None
    band_hz: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class ModelCurve:
    """A fitted model, evaluated for drawing.

    Attributes
    ----------
    x : ndarray, shape (k,)
        Averaging times in s for a deviation, frequencies in Hz for a density.
    total : ndarray, shape (k,)
        Deviation, or one-sided density, of the whole model.
    components : mapping
        Name (N, B, K, ..., or the kind of an effect) to its own curve, shape (k,).
    """

    x: NDArray[np.float64]
    total: NDArray[np.float64]
    components: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class AxisAnalysis:
    """What is known of one axis.

    Attributes
    ----------
    unit : str
        ``dps`` or ``g``.
    curves : mapping
        Estimator name to its curve (one axis, only taus that have a value).
    coefficients : mapping
        Q, N, B, K, R; empty until the first fit.
    readings : mapping
        ``N``, ``N_1s``, ``B``, ``K`` as read off the curves, those that can be.
    power_laws : mapping
        Coefficients of the power laws that were asked for, Q P N B K F D, fitted together.
    coefficients_as_of : AsOf or None
        What they were fitted to: all there is, unless a fit has failed since.
    explanation_as_of : AsOf or None
        What the last search for effects has seen.
    model, model_before : ModelCurve or None
        Deviation (``oadev``) of the final model and of the textbook model.
    density : Density or None
        Measured one-sided density.
    density_model : ModelCurve or None
        Density of the final model at the frequencies of `density`.
    comparison : Comparison or None
        With the curve of an earlier session or a mask, where one was named.
    failure : str
        What went wrong in the analysis of this axis, empty when nothing did: then only what is
        independent of it is here.
    """

    unit: str
    curves: Mapping[str, Deviation]
    level: Level | None = None
    coefficients: Mapping[str, Coefficient] = field(default_factory=dict)
    best_averaging: BestAveraging | None = None
    datasheet: Mapping[str, DatasheetVerdict] = field(default_factory=dict)
    density: Density | None = None
    model: ModelCurve | None = None
    model_before: ModelCurve | None = None
    density_model: ModelCurve | None = None
    explanation: AxisExplanation | None = None
    remarks: tuple[str, ...] = ()
    failure: str = ""
    readings: Mapping[str, Reading] = field(default_factory=dict)
    power_laws: Mapping[str, Coefficient] = field(default_factory=dict)
    coefficients_as_of: AsOf | None = None
    explanation_as_of: AsOf | None = None
    comparison: Comparison | None = None

    @property
    def is_constant(self) -> bool:
        """Whether all samples are equal: every Allan deviation is 0, there is no noise."""
        curve = self.curves.get("oadev")
        return curve is not None and len(curve.tau) > 0 and not np.any(curve.deviation)


@dataclass(frozen=True, slots=True)
class Analysis:
    """The result of a run, or of a run so far.

    Attributes
    ----------
    input : mapping
        Where the samples came from: name, wire format, file hash, device identity.
    lost_samples : int
        Samples known to be missing; `unknown_losses` counts the gaps of unknown length.
    failures : tuple of str
        What failed beside the measurement, a line each: recording, charts, files.
    segments : int
        Contiguous stretches of samples.
    temperature : mapping
        ``first``, ``last``, ``lowest``, ``highest`` in degC; empty when there is none.
    marks : tuple of (seconds, text)
        Set by the user during the run.
    events : tuple of Event
        What has changed during the run, as it was found while it went on; in order of their onset.
    assumptions : tuple of str
        What the input did not say and the result rests on: units, scales, columns that were taken
        for something. They stand at the top of whatever shows the result.
    remarks : tuple of str
        What the reader must know about the run as a whole, one sentence each.
    undisturbed : Undisturbed or None
        The longest stretch without an event, and its coefficients; None where there are no events.
    dynamic : DynamicDeviation or None
        The Allan deviation over time, of all axes in their order; not part of the JSON.
    record : Record or None
        The kept time series, for figures; not part of the JSON.
    origin : {'', 'measured', 'synthetic', 'emulated'}
        Whether a physical part measured the samples, as the device says; empty when it does not.
    choices : CurveChoices
        How the curves were made, and what is shown of them.
    traces : mapping
        What findings were traced to, by axis and index of the leading effect.
    common : tuple of CoherentBand
        Ranges of frequencies in which axes are coherent, from low to high.
    reference : str
        Name of the earlier session, or of the mask, with which the axes are compared; empty when
        none was named.
    """

    input: Mapping[str, str]
    part: str
    duration_s: float
    samples: int
    lost_samples: int
    segments: int
    rate: Rate
    link: LinkStats
    axes: Mapping[str, AxisAnalysis]
    reconnects: int = 0
    unknown_losses: int = 0
    failures: tuple[str, ...] = ()
    temperature: Mapping[str, float] = field(default_factory=dict)
    marks: tuple[tuple[float, str], ...] = ()
    events: tuple[Event, ...] = ()
    remarks: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    version: str = ""
    undisturbed: Undisturbed | None = None
    dynamic: DynamicDeviation | None = None
    record: Record | None = None
    origin: Origin = ""
    choices: CurveChoices = field(default_factory=CurveChoices)
    traces: Mapping[tuple[str, int], Trace] = field(default_factory=dict)
    common: tuple[CoherentBand, ...] = ()
    reference: str = ""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects of the stream as a whole, such as the error of its clock: each once."""
        found: dict[str, Effect] = {}
        for axis in self.axes.values():
            for effect in axis.explanation.effects if axis.explanation else ():
                if effect.traits.of_the_stream:
                    found.setdefault(effect.kind, effect)
        return tuple(found.values())

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Effects of the axes, with what is one disturbance put together; named ones first."""
        looked = {k: a.explanation for k, a in self.axes.items() if not a.failure}
        known = {k: one for k, one in looked.items() if one is not None}
        excess = {k: one.shares.excess_nats for k, one in known.items() if one.shares}
        found = findings_of({k: one.effects for k, one in known.items()}, excess, self.rate.best_hz)
        return tuple(self._traced(one) for one in found)

    def _traced(self, finding: Finding) -> Finding:
        trace = self.traces.get((finding.members[0].axis, finding.members[0].index))
        if trace is None:
            return finding
        return replace(finding, origin=trace.origin, motion=trace.motion, leak=trace.leak)

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """Next measurements, for what the record cannot decide, shortest first."""
        return next_experiments(self)

    @property
    def uncertainty(self) -> dict[str, Any]:
        """How the uncertainties of the coefficients were obtained, and what is in them."""
        rate = self.rate
        clock = "the sample rate, which was not measured: these parts deviate by up to 5 %"
        if rate.measured_hz is not None and rate.uncertainty_ppm is not None:
            clock = f"the sample rate, known to {rate.uncertainty_ppm:.2g} ppm"
        return {
            "method": "expanded uncertainty (k = 2), twice the standard uncertainty; that is half "
            "the 95 % interval of the likelihood, divided by 1.96. Degrees of freedom: 1 / (2 u^2) "
            "with the relative standard uncertainty u. Where the interval is not symmetric, prefer "
            "the interval",
            "included": [
                "sampling error of the noise over this run",
                "the other coefficients and the shape of filters, which are fitted together",
            ],
            "not_included": [
                f"{clock}; N and K change by half of it, Q and R by all of it",
                "the scale factor of the part, by which every coefficient is multiplied",
                "temperature, supply, mounting and part other than those of this run",
                "effects that were not found",
            ],
        }

    def summary(self) -> str:
        """Return the verdict, N, B and K of each axis, and what else must be known, as lines."""
        from allanscope.analysis.notebook import summary_text

        return summary_text(self)

    def plot(self, kind: str = "oadev", axes: Sequence[str] | None = None) -> Figure:
        """Draw the curves of one estimator, with their intervals and, dashed, the model.

        Parameters
        ----------
        kind : str
            Estimator.
        axes : sequence of str, optional
            Axes to draw; by default all.

        Returns
        -------
        matplotlib Figure
            One chart a sensor. `Deviation.plot` draws one curve into a chart of your own.

        Raises
        ------
        ValueError
            When no axis has such a curve.
        """
        from allanscope.analysis.notebook import overlay

        return overlay(self, kind, axes)

    def to_dataframe(self) -> Any:
        """Return a row for each coefficient of each axis, as a table of pandas or polars.

        Raises
        ------
        ImportError
            When neither is installed.
        """
        from allanscope.analysis.notebook import coefficients_frame

        return coefficients_frame(self)

    def __repr__(self) -> str:
        """Return what it is of, in one line: `summary` says what was found."""
        name = self.input.get("name", "")
        return f"<Analysis {name}: {' '.join(self.axes)}, {self.samples} samples>"

    def _repr_html_(self) -> str:
        from allanscope.analysis.notebook import html

        return html(self)

    def to_dict(self) -> dict[str, Any]:
        """Return the result in the schema ``allanscope/1``: plain numbers, null for what is not."""
        result: dict[str, Any] = {
            "schema": SCHEMA,
            "allanscope": self.version,
            "input": dict(self.input),
            "part": self.part,
            "origin": self.origin or None,
            "duration_s": self.duration_s,
            "samples": self.samples,
            "lost_samples": self.lost_samples,
            "unknown_losses": self.unknown_losses,
            "segments": self.segments,
            "rate": _plain(asdict(self.rate)),
            "link": {
                "bytes": self.link.bytes,
                "frames": self.link.frames,
                "crc_errors": self.link.crc_errors,
                "resyncs": self.link.resyncs,
                "unknown": self.link.unknown,
                "suspect": self.link.suspect,
                "reconnects": self.reconnects,
            },
            "temperature": dict(self.temperature),
            "marks": [{"time_s": time_s, "text": text} for time_s, text in self.marks],
            "events": [event_dict(event) for event in self.events],
            "undisturbed": _undisturbed_dict(self.undisturbed),
            "assumptions": list(self.assumptions),
            "remarks": [*self.assumptions, *self.remarks],
            "failures": list(self.failures),
            "effects": [_effect_dict(effect) for effect in self.effects],
            "curve_choices": asdict(self.choices),
            "uncertainty": self.uncertainty,
            "findings": [_finding_dict(finding) for finding in self.findings],
            "experiments": [asdict(one) for one in self.experiments],
            "common": [asdict(one) for one in self.common],
            "axes": {name: _axis_dict(axis, self.choices) for name, axis in self.axes.items()},
        }
        return cast("dict[str, Any]", _plain(result))


def _axis_dict(axis: AxisAnalysis, choices: CurveChoices) -> dict[str, Any]:
    """Return one axis; every key is there also where nothing is known yet."""
    return {
        "unit": axis.unit,
        "curves": {kind: _curve_dict(curve, choices) for kind, curve in axis.curves.items()},
        "level": asdict(axis.level) if axis.level else None,
        "coefficients": {
            name: _coefficient_dict(axis.coefficients[name])
            if name in axis.coefficients
            else {**_UNKNOWN, "unit": axis.unit + unit}
            for name, unit in _UNITS.items()
        },
        "readings": {
            name: asdict(axis.readings[name]) if name in axis.readings else None
            for name in READINGS
        },
        "power_laws": {name: _coefficient_dict(one) for name, one in axis.power_laws.items()},
        "coefficients_as_of": asdict(axis.coefficients_as_of) if axis.coefficients_as_of else None,
        "best_averaging": asdict(axis.best_averaging) if axis.best_averaging else None,
        "datasheet": {k: asdict(v) for k, v in axis.datasheet.items()}
        or {"density": {**_NOT_COMPARED, "unit": f"{axis.unit}/sqrt(Hz)"}},
        **_explanation_dict(axis.explanation or _NOT_SEARCHED),
        "effects_as_of": asdict(axis.explanation_as_of) if axis.explanation_as_of else None,
        "comparison": axis.comparison.to_dict() if axis.comparison else None,
        "failure": axis.failure or None,
        "remarks": list(axis.remarks),
    }


def _undisturbed_dict(found: Undisturbed | None) -> dict[str, Any] | None:
    if found is None:
        return None
    axes = {
        axis: {name: _coefficient_dict(one) for name, one in coefficients.items()}
        for axis, coefficients in found.axes.items()
    }
    return {"begin_s": found.begin_s, "end_s": found.end_s, "axes": axes}


def _coefficient_dict(one: Coefficient) -> dict[str, Any]:
    known = one.uncertainty
    return {**asdict(one), "uncertainty": asdict(known) if known else None}


_UNITS = {"N": "/sqrt(Hz)", "B": "", "K": "/sqrt(s)", "Q": "*s", "R": "/s"}
_UNKNOWN = {
    **{"value": None, "lower": None, "upper": None, "detected": False, "wait_s": None},
    **{"white_alone": None, "decoupled": None, "uncertainty": None},
}
_NOT_COMPARED: dict[str, Any] = {
    "limit": None,
    "measured": None,
    "verdict": "not compared",
    "explanation": "needs the name of the part and the full scale of the axis",
    "details": {},
}
_NO_ERROR = ResidualError(*[math.nan] * 5)
_NOT_SEARCHED = AxisExplanation((), _NO_ERROR, _NO_ERROR, {}, {}, math.nan, math.nan, False)


def _curve_dict(curve: Deviation, choices: CurveChoices) -> dict[str, Any]:
    """Return the columns of a curve, as arrays."""
    names = ("tau", "deviation", "lower", "upper", "edf", "terms", "noise", "trusted")
    arrays = {name: getattr(curve, name) for name in names}
    if choices.variance:
        arrays["variance"] = curve.variance
    if choices.simple_limits:
        arrays["simple_lower"], arrays["simple_upper"] = curve.simple_limits()
    return arrays


def _explanation_dict(explanation: AxisExplanation) -> dict[str, Any]:
    return {
        "coefficients_before": {
            k: _coefficient_dict(c) for k, c in explanation.coefficients_before.items()
        },
        "effects": [_effect_dict(effect) for effect in explanation.effects],
        "search": [asdict(step) for step in explanation.path],
        "residual": {
            "before": asdict(explanation.before),
            "after": asdict(explanation.after),
            "held_out_nats": explanation.held_out_nats,
            "held_out_nats_se": explanation.held_out_nats_se,
            "explained": explanation.explained,
            "shares": asdict(explanation.shares) if explanation.shares else None,
            "remarks": list(explanation.remarks),
        },
    }


def _effect_dict(effect: Effect) -> dict[str, Any]:
    return {
        "kind": effect.kind,
        "parameters": {k: asdict(p) for k, p in effect.parameters.items()},
        "equivalent": list(effect.equivalent),
        "axes": list(effect.axes),
        "share": effect.share,
        "given_detection": asdict(effect.given_detection) if effect.given_detection else None,
        "evidence": dict(effect.evidence),
    }


def event_dict(event: Event) -> dict[str, Any]:
    """Return an event as it stands in the JSON."""
    return cast("dict[str, Any]", _plain({**asdict(event), **_more_of(event)}))


def _more_of(event: Event) -> dict[str, Any]:
    return {"size": event.size, "present": event.is_present, "words": event.words}


def _finding_dict(finding: Finding) -> dict[str, Any]:
    return {
        "kind": finding.kind,
        "axes": list(finding.axes),
        "gain_nats": finding.gain_nats,
        "share": finding.share,
        "harmonics": list(finding.harmonics),
        "folded": list(finding.folded),
        "mixed": list(finding.mixed),
        "comb": finding.comb._asdict() if finding.comb else None,
        "effects": [{"axis": one.axis, "index": one.index} for one in finding.members],
        "origin": asdict(finding.origin) if finding.origin else None,
        "motion": asdict(finding.motion) if finding.motion else None,
        "leak": asdict(finding.leak) if finding.leak else None,
    }


def _plain(value: Any) -> Any:
    """Return the value with numpy types made plain and everything that is not finite made None."""
    if type(value) is float:
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        plain = value.tolist()
        is_finite = value.dtype.kind in "iubU" or (
            value.dtype.kind == "f" and np.isfinite(value).all()
        )
        return plain if is_finite else _plain(plain)
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return value
