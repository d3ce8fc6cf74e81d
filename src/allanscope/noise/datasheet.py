"""What was measured against what the datasheet says.

Two conventions meet here and differ by sqrt(2). IEEE 952 defines N by the *two-sided* density, so
that ADEV(1 s) = N. A datasheet's density in dps/sqrt(Hz) is taken as *one-sided*, what an analyser
shows or the rms over the root of the bandwidth, and equals sqrt(2) N. ST's design tip DT0064 reads
it differently: it takes the angle random walk for the density itself, as if N were one-sided; that
reading is given beside the other. Either way an angle that is integrated for a time t has the
standard deviation ARW sqrt(t): 0.24 deg/sqrt(h) make 0.24 deg after an hour.

Typical values are typical: within 20 % a part is what the datasheet says. In normal and low-power
mode ST publishes an rms over half the rate instead of a density.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from allanscope.noise.coefficients import Coefficient, DatasheetVerdict
from allanscope.parts import Part
from allanscope.quantities import DENSITY

__all__ = ["compare", "published_density", "published_rms"]

_TYPICAL = 0.2
_ROOT_TWO = float(np.sqrt(2.0))


def compare(
    part: Part,
    axis: str,
    white: Coefficient | None,
    *,
    rate_hz: float,
    full_scale: float,
    rms: float | None = None,
    high_performance: bool = True,
) -> dict[str, DatasheetVerdict]:
    """Return the verdict on the noise of one axis.

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
    full_scale : float
        In dps or g.
    rms : float, optional
        Standard deviation of the samples without drifts; needed in normal and low-power mode.
    high_performance : bool
        Whether the part runs in that mode at low rates as well.

    Returns
    -------
    dict
        ``density`` in high-performance mode, ``rms`` in the others.
    """
    mode = part.mode(rate_hz, high_performance=high_performance)
    if mode == "high-performance":
        return {"density": _density(part, axis, white, full_scale)}
    limit = published_rms(part, axis, full_scale)
    unit = "dps" if axis.startswith("g") else "g"
    if limit is None:
        return {"rms": DatasheetVerdict(None, rms, unit, "not published", part.source)}
    return {"rms": _rms(limit, rms, unit, rate_hz, mode)}


def published_density(part: Part, axis: str, full_scale: float) -> float | None:
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


def published_rms(part: Part, axis: str, full_scale: float) -> float | None:
    """Return the rms noise in normal and low-power mode in dps or g, None where there is none."""
    if axis.startswith("g"):
        return part.gyro_rms
    return _at(part.accel_rms, full_scale)


def _at(table: Mapping[float, float] | None, full_scale: float) -> float | None:
    return None if table is None else table.get(full_scale)


def _density(
    part: Part, axis: str, white: Coefficient | None, full_scale: float
) -> DatasheetVerdict:
    base = "dps" if axis.startswith("g") else "g"
    unit = f"{base}/sqrt(Hz)"
    limit = published_density(part, axis, full_scale)
    if white is None or not white.detected:
        measured, details = None, {}
    else:
        measured = _ROOT_TWO * white.value
        details = {
            "lower": _ROOT_TWO * white.lower,
            "upper": _ROOT_TWO * white.upper,
            "N": white.value,
            "dt0064_density": white.value,
        }
        if base == "dps":
            details["arw_deg_per_sqrt_hour"] = 60 * white.value
            details["angle_after_one_hour_deg"] = 60 * white.value
    if limit is None:
        return DatasheetVerdict(None, measured, unit, "not published", part.source, details)
    if measured is None:
        words = "the white noise is not known yet"
        return DatasheetVerdict(limit, None, unit, "not known yet", words, details)
    factor, shown = DENSITY[base].factor, DENSITY[base].unit
    details |= {"ratio": measured / limit, "dt0064_ratio": measured / _ROOT_TWO / limit}
    verdict = _judge(details["lower"], details["upper"], limit)
    explanation = (
        f"one-sided density sqrt(2) N = {factor * measured:.3g} {shown} against"
        f" {factor * limit:.3g} typical ({part.name}, one-sided); N itself, which DT0064 takes for"
        f" the density, is {factor * measured / _ROOT_TWO:.3g}"
    )
    return DatasheetVerdict(limit, measured, unit, verdict, explanation, details)


def _rms(limit: float, rms: float | None, unit: str, rate_hz: float, mode: str) -> DatasheetVerdict:
    density = limit / float(np.sqrt(rate_hz / 2))
    details = {"equivalent_density": density}
    if rms is None:
        words = f"no rms was measured; the datasheet gives one for {mode} mode"
        return DatasheetVerdict(limit, None, unit, "not known yet", words, details)
    details["ratio"] = rms / limit
    words = f"rms in {mode} mode over half the rate, {rms:.3g} {unit} against {limit:.3g} typical"
    return DatasheetVerdict(limit, rms, unit, _judge(rms, rms, limit), words, details)


def _judge(lower: float, upper: float, limit: float) -> str:
    if upper < (1 - _TYPICAL) * limit:
        return "better"
    return "worse" if lower > (1 + _TYPICAL) * limit else "typical"
