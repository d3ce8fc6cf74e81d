"""The fit: from what a run keeps to the coefficients of IEEE 952, with intervals that hold.

::

    rows, density ──▶ evidence ──▶ N B K by maximum likelihood ──▶ ramp? low-pass? Q? ──▶ NoiseFit

A coefficient is *detected* when the likelihood without it is too poor for chance: at zero twice the
loss is 0 or chi-square(1) with equal odds, and 9.5 has a probability of 1 in 1000. Otherwise its
interval begins at 0 and its upper end is the limit that the run sets. The values are bias-reduced
and the intervals profiles of the likelihood (`estimates`), and the model for curves and
residuals is the maximum of the likelihood itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.history import Record
from allanscope.noise.coefficients import Coefficient
from allanscope.noise.components import Floor, Ramp, Rounding
from allanscope.noise.drift import fit_drift
from allanscope.noise.estimates import Estimates, ramp_coefficient
from allanscope.noise.evidence import Evidence, Ordinates, evidence_of, stretches_of, with_ranges
from allanscope.noise.filters import HeldPattern, HeldSamples, LowPass
from allanscope.noise.gap_bridging import bridge_gaps, worth_of
from allanscope.noise.grid import Ranges
from allanscope.noise.likelihood import Fit, Likelihood
from allanscope.noise.model import NoiseModel
from allanscope.noise.part import Part as PartOfModel
from allanscope.noise.quantised import (
    LIMIT,
    on_lattice,
    resolution_advice,
    rounding_correlation,
)
from allanscope.noise.remainder import with_remainder
from allanscope.noise.selection import select, textbook
from allanscope.noise.whiteness import Bands, whitened
from allanscope.parts import Part
from allanscope.quantities import COEFFICIENTS, symbols
from allanscope.samples import unit_of
from allanscope.spectrum import Density

__all__ = ["Known", "NoiseFit", "fit_array", "fit_noise"]

Array = NDArray[np.float64]

_RAMP_DETECTED = 2 * math.log(1e3)
"""Twice the nats for a ramp, with K fitted beside it: below 1 in 1000 by simulation."""
_OFTEN = 0.1
"""Share of held samples."""
_SURE = 50.0
"""Degrees of freedom from which the power of a band is compared with that of rounding."""
_STOP_BAND = 0.05
"""Response of a low-pass below which a frequency is left out of the fit."""


@dataclass(frozen=True)
class NoiseFit:
    """What the noise of one axis is made of.

    Attributes
    ----------
    coefficients : mapping
        ``Q N B K R`` to value, 95 % interval, and whether it was detected.
    model : NoiseModel
        At the maximum of the likelihood, with the ramp where there is one.
    slope : float
        Signed ramp in unit/s, 0 where none was detected.
    band_limit : Coefficient or None
        Cutoff of the low-pass that the data ask for, in Hz.
    rounding : float
        White noise per sqrt(Hz) that is rounding to the LSB and no longer part of N; 0 where the
        samples are on no known lattice.
    step_limited : bool
        True when the noise is below half an LSB: then the numbers describe the rounding and not
        the sensor.
    evidence : tuple of Evidence
        What was fitted, ramp removed: for regressions, and to compare other models on.
    fit : Fit
        Maximum of the likelihood, with the information matrix.
    bands : Bands
        Whitened spectrum: measured over expected power.
    remarks : tuple of str
        What the reader must know.
    """

    coefficients: Mapping[str, Coefficient]
    model: NoiseModel
    slope: float
    band_limit: Coefficient | None
    rounding: float
    evidence: tuple[Evidence, ...]
    fit: Fit
    bands: Bands
    step_limited: bool = False
    remarks: tuple[str, ...] = ()

    def without_ordinates(self) -> NoiseFit:
        """Return it without the transform of every row: for what reads coefficients and models."""
        evidence = tuple(
            replace(part, raw=np.empty((0, 0))) if isinstance(part, Ordinates) else part
            for part in self.evidence
        )
        fit = replace(self.fit, likelihood=Likelihood(evidence))
        return replace(self, evidence=evidence, fit=fit)

    @property
    def chi2(self) -> float:
        """Sum of z^2 over the bands of the whitened spectrum."""
        return self.bands.chi2

    @property
    def dof(self) -> int:
        """Degrees of freedom of `chi2`."""
        return max(1, len(self.bands.z) - len(self.fit.free))

    @property
    def p_value(self) -> float:
        """Probability of as large a `chi2` where the model is right."""
        return self.bands.p_value(len(self.fit.free))


@dataclass(frozen=True, eq=False)
class Known:
    """What a search has found of an axis, beside which the noise is fitted.

    Attributes
    ----------
    parts : tuple of Part
        Processes, whose sizes are fitted, and filters.
    signal : ndarray, shape (n,), or None
        What is subtracted from the rows of the record: everything deterministic but the ramp.
    excluded : tuple of (low, high)
        Frequencies in Hz that are left out.
    doubtful : tuple of (low, high)
        Frequencies in Hz that the parts do not describe: the amplitudes are fitted beside them, and
        what they hold stands in the model as a smooth remainder.
    is_textbook : bool
        Whether there is to be no such remainder: for what everyone fits.
    """

    parts: tuple[PartOfModel, ...] = ()
    signal: Array | None = field(default=None, repr=False)
    excluded: Ranges = ()
    doubtful: Ranges = ()
    is_textbook: bool = False


def fit_noise(
    record: Record,
    axis: str,
    density: Density | None = None,
    *,
    part: Part | None = None,
    known: Known | None = None,
) -> NoiseFit:
    """Fit one axis of what a run keeps.

    Parameters
    ----------
    record : Record
        Rows of all axes.
    axis : str
        Which one.
    density : Density, optional
        Streaming spectrum of the samples of that axis, in physical units; fills in above the rows
        when these are averages.
    part : Part, optional
        Whose filters are offered to the fit.
    known : Known, optional
        What a search has found: then nothing else is offered.

    Raises
    ------
    ValueError
        If the axis is not in the record, is constant, or has no 16 rows without a gap.
    """
    if axis not in record.axes:
        raise ValueError(f"no axis {axis!r} in the record; it has {' '.join(record.axes)}")
    column = record.axes.index(axis)
    values = record.values[:, column]
    _refuse_constant(values)
    lsb = record.lsb[column]
    measured = values if record.filled is None else values[~record.filled]
    rounding = _rounding_of(measured * record.stride, lsb, record.stride)
    if known is not None and known.signal is not None:
        values = values - known.signal
    record = bridge_gaps(replace(record, axes=(axis,), values=values[:, np.newaxis], lsb=(lsb,)))
    values = record.values[:, 0]
    row_s = 1 / record.rate_hz
    stretches = stretches_of(values, [(int(a), int(b)) for a, b in record.segments])
    if not any(np.ptp(one, axis=-1).any() for one in stretches):
        # What does change lies in parts that are too short for a spectrum.
        raise ValueError("the axis is constant: there is no noise to fit")
    return _fit(
        evidence_of(stretches, row_s / record.stride, record.stride, density, worth_of(record)),
        dt=row_s / record.stride,
        duration=len(values) * row_s,
        unit=unit_of(axis),
        rounding=rounding,
        cutoffs=part.cutoffs_hz(axis, record.stride * record.rate_hz) if part else (),
        known=known,
    )


def fit_array(
    values: ArrayLike,
    rate: float,
    *,
    unit: str = "dps",
    lsb: float | None = None,
    part: Part | None = None,
) -> NoiseFit:
    """Fit one contiguous record of samples.

    Parameters
    ----------
    values : array_like, shape (n,)
        Samples in dps or g.
    rate : float
        Samples per second.
    unit : {'dps', 'g'}
        Of the values.
    lsb : float, optional
        Step of the values, of which the rounding noise is set apart.
    part : Part, optional
        Whose filters are offered to the fit.

    Raises
    ------
    ValueError
        If there are fewer than 16 values, or they are not finite or all the same.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> fit = fit_array(0.04 * rng.standard_normal(100_000), rate=100.0)
    >>> n = fit.coefficients["N"]
    >>> f"{n.value:.5f} {n.unit}", n.lower < 0.004 < n.upper, fit.coefficients["K"].detected
    ('0.00399 dps/sqrt(Hz)', True, False)
    """
    samples = np.asarray(values, np.float64)
    if samples.ndim != 1:
        raise ValueError(f"need values of shape (n,), got {samples.shape}")
    _refuse_constant(samples)
    return _fit(
        evidence_of([samples[np.newaxis]], 1 / rate),
        dt=1 / rate,
        duration=len(samples) / rate,
        unit=unit,
        rounding=_rounding_of(samples, lsb),
        cutoffs=part.cutoffs_hz("ax" if unit == "g" else "gx", rate) if part else (),
    )


def _rounding_of(samples: Array, lsb: float | None, stride: int = 1) -> Rounding | None:
    """Return the rounding of samples, or of sums of so many; None where they are on no lattice.

    Of sums the correlation is not known.
    """
    if not (lsb and on_lattice(samples, lsb)):
        return None
    return Rounding(lsb, rounding_correlation(samples, lsb) if stride == 1 else ())


def _refuse_constant(values: NDArray[np.float64]) -> None:
    """Raise for a dead axis, of whose spectrum rounding would leave something to fit."""
    if len(values) and values.min() == values.max():
        raise ValueError("the axis is constant: there is no noise to fit")


def _fit(
    evidence: tuple[Evidence, ...],
    *,
    dt: float,
    duration: float,
    unit: str,
    rounding: Rounding | None,
    cutoffs: tuple[float, ...],
    known: Known | None = None,
) -> NoiseFit:
    if known is not None and known.excluded:
        evidence = tuple(part.without(known.excluded) for part in evidence)
    doubtful = known.doubtful if known is not None else ()
    likelihood = Likelihood([part.without(doubtful) for part in evidence] if doubtful else evidence)
    if not np.any(likelihood.power > 0):
        raise ValueError("the axis is constant: there is no noise to fit")
    parts = known.parts if known is not None else ()
    carries = rounding and _carries_rounding(likelihood, rounding, dt) and not _held(parts)
    rounded = rounding if carries else None
    fit = likelihood.amplitudes(textbook(dt, rounded).plus(*parts))
    # A drift that was subtracted has taken a ramp with it, and leaves one in its tails alone.
    drifted = known is not None and any(low <= 0.0 for low, _ in known.excluded)
    drift = None if drifted else fit_drift(fit)
    ramp = drift is not None and 2 * drift.gain > _RAMP_DETECTED
    if drift is not None and ramp:
        fit = drift.fit
    fit = _without_stop_band(select(fit, cutoffs) if known is None else fit)
    if known is not None and not known.is_textbook:
        fit = with_remainder(fit, with_ranges(fit.likelihood.evidence, evidence, doubtful))
    estimates = Estimates(fit, dt, duration, unit)
    coefficients = {
        "Q": estimates.quantization(),
        **{name: estimates.coefficient(name) for name in "NBK"},
        "R": ramp_coefficient(drift, ramp, duration, unit),
    }
    lsb = rounding.lsb if rounding else 0.0
    limited = rounding is not None and not rounding.correlation
    limited = limited and _short_term(fit, dt) < LIMIT * lsb
    slope = drift.slope if drift is not None and ramp else 0.0
    evidence = fit.likelihood.evidence
    return NoiseFit(
        coefficients=coefficients,
        model=fit.model.plus(*((Ramp(abs(slope)),) if slope else ())),
        slope=slope,
        band_limit=estimates.coefficient("cutoff") if fit.index("cutoff") is not None else None,
        rounding=rounded.lsb * float(np.sqrt(dt / 12)) if rounded else 0.0,
        evidence=evidence,
        fit=fit,
        bands=whitened(evidence, fit.expected),
        step_limited=limited,
        remarks=_remarks(coefficients, fit, unit, resolution_advice(unit, lsb) if limited else ""),
    )


def _without_stop_band(fit: Fit) -> Fit:
    """Leave out what lies beyond a low-pass: little but the unknown details of the filter.

    A floor of white noise behind it is known by nothing else.
    """
    low_pass = next((f for f in fit.model.filters if isinstance(f, LowPass)), None)
    if low_pass is None or fit.model.value("N") == 0.0 or fit.model.get(Floor.symbol):
        return fit
    dt = fit.model.dt
    frequency = np.linspace(0.0, 0.5 / dt, 2048)
    highest = float(frequency[low_pass.response(frequency, dt) > _STOP_BAND][-1])
    stop_band = ((highest, np.inf),)
    narrower = Likelihood([part.without(stop_band) for part in fit.likelihood.evidence])
    return narrower.maximise(fit.model, held=fit.held)


def _held(parts: tuple[PartOfModel, ...]) -> bool:
    """Whether rows are held so often that their rounding is as little white as what they repeat."""
    held = (part for part in parts if isinstance(part, HeldSamples | HeldPattern))
    return any(part.fraction > _OFTEN for part in held)


def _carries_rounding(likelihood: Likelihood, rounding: Rounding, dt: float) -> bool:
    """Whether there is as much noise everywhere as rounding makes: less, and it was not rounded."""
    bands = whitened(likelihood.evidence, likelihood.expected(NoiseModel((rounding,), dt)))
    sure = bands.dof > _SURE
    return bool(np.all(bands.ratio[sure] > 1 - 4 * np.sqrt(2 / bands.dof[sure])))


def _short_term(fit: Fit, dt: float) -> float:
    """Return the standard deviation of samples about their neighbours, before rounding."""
    parts = [c.avar(1, dt) for c in fit.model if not isinstance(c, Rounding)]
    return float(np.sqrt(np.sum(parts)))


def _remarks(
    coefficients: Mapping[str, Coefficient], fit: Fit, unit: str, coarse: str
) -> tuple[str, ...]:
    remarks = [coarse] if coarse else []
    ramp, usual = coefficients["R"], COEFFICIENTS[unit, "R"][0]
    if ramp.detected:
        drift = usual.interval(ramp.value, ramp.lower, ramp.upper)
        remarks.append(
            symbols(f"R detected: the level drifts in a straight line, by {drift} {usual.unit}")
        )
    if coefficients["Q"].detected:
        remarks.append(
            "Q detected: the density rises towards high frequencies, and N is its level below that "
            "rise; in a rate sensor the cause is nearly always vibration, aliasing or a filter, "
            "hardly ever quantization of an angle"
        )
    if not fit.converged:
        remarks.append("the fit did not converge: its values are the best found")
    return tuple(remarks)
