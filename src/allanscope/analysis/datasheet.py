"""What was measured against what the datasheet says.

Two conventions meet here and differ by sqrt(2). IEEE 952 defines N by the *two-sided* density, so
that ADEV(1 s) = N. A datasheet's density in dps/sqrt(Hz) is taken as *one-sided*, what an analyser
shows or the rms over the root of the bandwidth, and equals sqrt(2) N. ST's design tip DT0064 reads
it differently: it takes the angle random walk for the density itself, as if N were one-sided; that
reading is given beside the other. Either way an angle that is integrated for a time t has the
standard deviation ARW sqrt(t): 0.24 deg/sqrt(h) make 0.24 deg after an hour.

ST publishes the density of high-performance mode, and for normal and low-power mode an rms over
half the rate. A stream does not say in which mode the part runs: where the rate allows a slower
mode both verdicts are given, each with its condition.

Typical values are typical: within 20 % a part is what the datasheet says.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from allanscope.noise import Coefficient, DatasheetVerdict
from allanscope.parts import Mode, Part
from allanscope.quantities import DENSITY, LEVEL
from allanscope.samples import unit_of
from allanscope.spectrum import Density

__all__ = ["compare", "published_density", "published_rms", "rms_of"]

_TYPICAL = 0.2
_ROOT_TWO = float(np.sqrt(2.0))
_DRIFT_HZ = 0.1
"""Frequency below which a movement is drift and not part of an rms noise."""


HIDDEN = "hidden by the step"
"""Verdict on an axis whose noise is below half a step of its values."""


def compare(
    part: Part,
    axis: str,
    white: Coefficient | None,
    *,
    rate_hz: float,
    full_scale: float | None,
    rms: float | None = None,
    step_limited: bool = False,
) -> dict[str, DatasheetVerdict]:
    """Return the verdicts on the noise of one axis.

    Parameters
    ----------
    part : Part
        Whose datasheet.
    axis : str
        ``gx`` ... ``az``.
    white : Coefficient or None
        N of that axis; None before the first fit.
    rate_hz : float
        Sample rate.
    full_scale : float or None
        In dps or g; None where it is not known, and then there is nothing to compare an
        accelerometer with, whose noise depends on it.
    rms : float, optional
        Standard deviation of the samples without drifts, as from `rms_of`.
    step_limited : bool
        The step hides the noise: there is no verdict on the sensor then.

    Returns
    -------
    dict
        ``density``, for high-performance mode; ``rms`` where the rate allows a slower mode. Empty
        where the full scale decides and is not known.
    """
    if full_scale is None and unit_of(axis) == "g":
        return {}
    verdicts = {"density": _density(part, axis, white, full_scale)}
    mode = part.mode(rate_hz, high_performance=False)
    if mode != "high-performance":
        verdicts["rms"] = _rms(part, axis, full_scale, rms, rate_hz, mode)
    return {name: _hidden(one) if step_limited else one for name, one in verdicts.items()}


def _hidden(verdict: DatasheetVerdict) -> DatasheetVerdict:
    """Return a verdict that does not credit a sensor with noise that rounding has hidden."""
    if verdict.limit is None or verdict.measured is None:
        return verdict
    words = "the noise is below half a step: the figures describe quantization, not the sensor"
    return replace(verdict, verdict=HIDDEN, explanation=words)


def rms_of(density: Density) -> float | None:
    """Return the standard deviation of samples without what moves in more than ten seconds.

    None where no band of the density lies above 0.1 Hz.
    """
    fast = density.frequency - 0.5 * density.width >= _DRIFT_HZ
    if not fast.any():
        return None
    return float(np.sqrt(np.sum(density.density[fast] * density.width[fast])))


def published_density(part: Part, axis: str, full_scale: float | None) -> float | None:
    """Return the one-sided density of the datasheet in unit/sqrt(Hz), None where there is none.

    Examples
    --------
    >>> from allanscope.parts import part_named
    >>> published_density(part_named("LSM6DSL"), "az", 16.0)
    0.00013
    """
    if axis.startswith("g"):
        return part.gyro_density
    return _at(part.accel_density, full_scale)


def published_rms(part: Part, axis: str, full_scale: float | None) -> float | None:
    """Return the rms noise in normal and low-power mode in dps or g, None where there is none."""
    if axis.startswith("g"):
        return part.gyro_rms
    return _at(part.accel_rms, full_scale)


def _at(table: Mapping[float, float] | None, full_scale: float | None) -> float | None:
    return None if table is None or full_scale is None else table.get(full_scale)


def _density(
    part: Part, axis: str, white: Coefficient | None, full_scale: float | None
) -> DatasheetVerdict:
    base = unit_of(axis)
    unit = f"{base}/sqrt(Hz)"
    limit = published_density(part, axis, full_scale)
    known = white is not None and white.detected
    measured, details = _one_sided(white, base) if white is not None and known else (None, {})
    if limit is None:
        return DatasheetVerdict(None, measured, unit, "not published", part.source, details)
    if measured is None:
        words = "the white noise is not known yet"
        return DatasheetVerdict(limit, None, unit, "not known yet", words, details)
    details |= {"ratio": measured / limit, "dt0064_ratio": measured / _ROOT_TWO / limit}
    verdict = _verdict(details["lower"], details["upper"], limit)
    factor, shown = DENSITY[base].factor, DENSITY[base].unit
    explanation = (
        f"one-sided density sqrt(2) N = {factor * measured:.3g} {shown} against"
        f" {factor * limit:.3g} typical ({part.name}, one-sided); N itself, which DT0064 takes for"
        f" the density, is {factor * measured / _ROOT_TWO:.3g}"
    )
    if part.second_hand:
        explanation += f"; not verified in the datasheet: {part.source}"
    if base == "dps":
        explanation += (
            f"; final angle error = ARW sqrt(time): {details['arw_deg_per_sqrt_hour']:.3g} deg"
            f" after one hour, and {60 * limit:.3g} for the datasheet's density as DT0064 reads it"
        )
    return DatasheetVerdict(limit, measured, unit, verdict, explanation, details)


def _one_sided(white: Coefficient, base: str) -> tuple[float, dict[str, float]]:
    """Return sqrt(2) N and what follows from N."""
    details = {
        "lower": _ROOT_TWO * white.lower,
        "upper": _ROOT_TWO * white.upper,
        "N": white.value,
        "dt0064_density": white.value,
    }
    if base == "dps":
        details["arw_deg_per_sqrt_hour"] = 60 * white.value
        details["angle_after_one_hour_deg"] = 60 * white.value
    return _ROOT_TWO * white.value, details


def _rms(
    part: Part,
    axis: str,
    full_scale: float | None,
    rms: float | None,
    rate_hz: float,
    mode: Mode,
) -> DatasheetVerdict:
    unit = unit_of(axis)
    limit = published_rms(part, axis, full_scale)
    if limit is None:
        return DatasheetVerdict(None, rms, unit, "not published", part.source)
    details = {"equivalent_density": limit / float(np.sqrt(rate_hz / 2))}
    if rms is None:
        words = f"no rms was measured; the datasheet gives one for {mode} mode"
        return DatasheetVerdict(limit, None, unit, "not known yet", words, details)
    details["ratio"] = rms / limit
    factor, shown = LEVEL[unit].factor, LEVEL[unit].unit
    words = (
        f"if the part runs in {mode} mode: rms over half the rate, {factor * rms:.3g} {shown}"
        f" against {factor * limit:.3g} typical ({part.name})"
    )
    return DatasheetVerdict(limit, rms, unit, _verdict(rms, rms, limit), words, details)


def _verdict(lower: float, upper: float, limit: float) -> str:
    if upper < (1 - _TYPICAL) * limit:
        return "better"
    return "worse" if lower > (1 + _TYPICAL) * limit else "typical"
