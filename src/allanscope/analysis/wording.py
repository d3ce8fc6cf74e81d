"""Short texts for one coefficient, one effect, one rate: what fits in a cell or a log line."""

from __future__ import annotations

from collections.abc import Mapping

from allanscope.analysis.findings import UNEXPLAINED
from allanscope.analysis.result import Analysis, AxisAnalysis, Rate
from allanscope.explain import AxisExplanation, Effect, Parameter
from allanscope.labels import kind_name
from allanscope.noise import Coefficient
from allanscope.quantities import (
    COEFFICIENTS,
    DEVIATION,
    count,
    duration,
    measured,
    number,
    rate,
    rough,
    symbols,
)
from allanscope.samples import Origin

__all__ = [
    "as_of_text",
    "best_text",
    "clock_text",
    "coefficient_text",
    "coefficient_unit",
    "density_verdict",
    "effect_brief",
    "effect_text",
    "gaps_text",
    "losses_phrase",
    "losses_text",
    "parameter_text",
    "rate_text",
    "recorded_text",
    "shares_text",
    "simulation_notice",
    "wait_text",
]


_EXACT_S = 1e-6
"""No clock stamps arrivals better."""
_SURE = 3.0
"""A drift of fewer standard deviations is not told."""
_TOLD_LOSS = 0.01
"""Part of the recorded time that is missing and told with it."""


def coefficient_unit(axis_unit: str, name: str) -> str:
    """Return the unit in which a coefficient is shown, in print.

    >>> coefficient_unit("dps", "B")
    '°/h'
    """
    return symbols(COEFFICIENTS[axis_unit, name][0].unit)


def coefficient_text(axis_unit: str, name: str, coefficient: Coefficient | None) -> str:
    """Return a value with its interval, or an upper limit; ``-`` while nothing is known.

    >>> coefficient_text("dps", "N", Coefficient(0.004022, 0.00398, 0.00406, "dps/sqrt(Hz)", True))
    '4.02 [3.98, 4.06]'
    >>> coefficient_text("g", "B", Coefficient(0.0, 0.0, 12.1e-6, "g", False))
    '< 12'
    """
    if coefficient is None:
        return "-"
    reading = COEFFICIENTS[axis_unit, name][0]
    if not coefficient.detected:
        return reading.limit(coefficient.upper)
    return reading.interval(coefficient.value, coefficient.lower, coefficient.upper)


def wait_text(coefficient: Coefficient | None) -> str:
    """Return how much longer to run until a coefficient is known; empty when it is, or unknown.

    >>> wait_text(Coefficient(0.0, 0.0, 12.1e-6, "g", False, wait_s=630.0))
    '10 min'
    """
    if coefficient is None or coefficient.wait_s is None:
        return ""
    return rough(coefficient.wait_s)


def shares_text(explanation: AxisExplanation) -> str:
    """Return what of the excess over sampling error is named, nameless and left; empty if none.

    >>> from allanscope.explain import AxisExplanation, Shares
    >>> shares_text(AxisExplanation((), None, None, {}, {}, 0.0, 0.0, True,
    ...                             shares=Shares(80.0, 0.905, 0.075, 0.02)))
    '90.5 % in named effects, 7.5 % in unnamed ones, 2.0 % unexplained'
    """
    shares = explanation.shares
    if shares is None or not shares.excess_nats:
        return ""
    return (
        f"{100 * shares.named:.1f} % in named effects, {100 * shares.nameless:.1f} % in unnamed "
        f"ones, {100 * shares.left:.1f} % unexplained"
    )


def effect_text(effect: Effect) -> str:
    """Return one effect in one line, with the intervals of its parameters.

    >>> effect_text(Effect("sinusoid", {"frequency": Parameter(50.02, 50.0, 50.04, "Hz")}))
    'line: frequency 50.020 [50.000, 50.040] Hz'
    """
    if effect.kind == UNEXPLAINED and effect.evidence.get("words"):
        return symbols(f"{UNEXPLAINED}: {effect.evidence['words']}")
    parameters = ", ".join(
        f"{name.replace('_', ' ')} {parameter_text(value)}"
        for name, value in effect.parameters.items()
    )
    name = kind_name(effect.kind)
    text = f"{name}: {parameters}" if parameters else name
    if effect.equivalent:
        text += f"; or {' or '.join(map(kind_name, effect.equivalent))}"
    return text


def effect_brief(effect: Effect) -> str:
    """Return one effect as a phrase, in three digits.

    >>> effect_brief(Effect("step", {"time": Parameter(2999.8, 2999.0, 3000.9, "s")}))
    'step (time 50 min)'
    """
    if effect.brief:
        return effect.brief
    parts = (
        f"{name.replace('_', ' ')} {_value_text(parameter)}"
        for name, parameter in effect.parameters.items()
    )
    inside = ", ".join(parts)
    return kind_name(effect.kind) + (f" ({inside})" if inside else "")


def _value_text(parameter: Parameter) -> str:
    """Return one number of an effect without its interval; lengths of time as people say them."""
    if parameter.unit == "s" and not isinstance(parameter.value, str):
        return duration(parameter.value)
    return parameter_text(Parameter(parameter.value, unit=parameter.unit))


def rate_text(known: Rate) -> str:
    """Return the measured rate with its uncertainty, or the nominal one labelled as such.

    >>> rate_text(Rate(6660.0, 6664.217, 12.0)), rate_text(Rate(104.0))
    ('6664.22 Hz ±12 ppm', '104 Hz nominal')
    """
    if known.measured_hz is None:
        return f"{rate(known.nominal_hz)} nominal" if known.nominal_hz else "rate not known yet"
    return symbols(rate(known.measured_hz, known.uncertainty_ppm))


def clock_text(known: Rate) -> str:
    """Return the jitter of the arrivals, and the drift of the rate where it is significant.

    The times of a file may be computed: then there is nothing to say of arrivals.

    >>> clock_text(Rate(104.0, 107.2, 3.0, residual_s=3.1e-4))
    'arrival jitter 0.31 ms'
    >>> clock_text(Rate(104.0, 107.2, 3.0, residual_s=3.1e-4, drift_ppm_per_h=-41.3,
    ...     drift_uncertainty_ppm_per_h=2.0, ppm_per_degc=20.2, ppm_per_degc_uncertainty=0.3))
    'arrival jitter 0.31 ms, rate drift -41 ppm/h, +20 ppm/°C'
    """
    parts = []
    if known.residual_s is not None and known.residual_s > _EXACT_S:
        parts.append(f"arrival jitter {number(1e3 * known.residual_s, 2)} ms")
    moves = (
        (known.drift_ppm_per_h, known.drift_uncertainty_ppm_per_h, "ppm/h"),
        (known.ppm_per_degc, known.ppm_per_degc_uncertainty, "ppm/°C"),
    )
    for value, sigma, unit in moves:
        if value is not None and sigma is not None and abs(value) > _SURE * sigma:
            drift = "" if len(parts) > 1 or unit != "ppm/h" else "rate drift "
            parts.append(f"{drift}{'+' if value > 0 else ''}{number(value, 2)} {unit}")
    return ", ".join(parts)


def as_of_text(axes: Mapping[str, AxisAnalysis]) -> str:
    """Return how long the run was when its numbers were computed; empty while there are none.

    Where axes differ it is the oldest: nothing that is shown is older.

    >>> from allanscope.analysis.result import AsOf
    >>> as_of_text({"gx": AxisAnalysis("dps", {}, coefficients_as_of=AsOf(18.0, 1872))})
    'Coefficients as of 18 s (1 872 samples)'
    """
    fitted = [axis.coefficients_as_of for axis in axes.values() if axis.coefficients_as_of]
    searched = [axis.explanation_as_of for axis in axes.values() if axis.explanation_as_of]
    parts = []
    if fitted:
        oldest = min(fitted, key=lambda one: one.time_s)
        moment = f"{duration(oldest.time_s)} ({count(oldest.samples)} samples)"
        parts.append(f"coefficients as of {moment}")
    if searched:
        parts.append(f"effects as of {duration(min(one.time_s for one in searched))}")
    return ", ".join(parts).capitalize()


def best_text(axis: AxisAnalysis) -> str:
    """Return the least deviation and its tau, and whether the curve has not risen beyond it."""
    best = axis.best_averaging
    if best is None or axis.is_constant:
        return "-"
    value = number(best.deviation * DEVIATION[axis.unit].factor)
    return f"{value} at {duration(best.tau)}{', no rise yet' if best.at_end else ''}"


def density_verdict(axis: AxisAnalysis) -> str:
    """Return what the datasheet says of the noise density; ``-`` if it says nothing."""
    found = axis.datasheet.get("density")
    return "-" if found is None or axis.is_constant else found.verdict


def losses_text(analysis: Analysis) -> str:
    """Return what is missing: ``none``, a number of samples, gaps of unknown length."""
    parts = []
    if analysis.lost_samples:
        parts.append(count(analysis.lost_samples))
    if analysis.unknown_losses:
        plural = "s" if analysis.unknown_losses > 1 else ""
        parts.append(f"{analysis.unknown_losses} gap{plural} of unknown length")
    return " + ".join(parts) or "none"


def losses_phrase(analysis: Analysis) -> str:
    """Return the losses, as printed beside the number of samples."""
    return f"lost samples: {losses_text(analysis)}"


def recorded_text(analysis: Analysis, recorded_s: float | None = None) -> str:
    """Return how long a record is, and within what time where a hundredth and more of it is lost.

    Parameters
    ----------
    analysis : Analysis
        What was recorded.
    recorded_s : float, optional
        Time of all the samples that came (s), where some came after the result.
    """
    kept_s = analysis.duration_s if recorded_s is None else recorded_s
    rate_hz = analysis.rate.best_hz
    lost_s = analysis.lost_samples / rate_hz if rate_hz else 0.0
    within = f" within {duration(kept_s + lost_s)}" if lost_s > _TOLD_LOSS * kept_s else ""
    return f"{duration(kept_s)}{within}"


def gaps_text(segments: int) -> str:
    """Return how many gaps there are between segments.

    >>> gaps_text(1), gaps_text(2), gaps_text(4)
    ('no gaps', '1 gap', '3 gaps')
    """
    gaps = max(segments - 1, 0)
    return f"{gaps or 'no'} gap{'s' * (gaps != 1)}"


def simulation_notice(origin: Origin) -> tuple[str, str] | None:
    """Return the notice above every result whose samples no part measured, and why; else None.

    >>> simulation_notice("synthetic")
    ('Simulated data', 'a program computed the samples; no part was measured')
    >>> simulation_notice("measured") is None
    True
    """
    match origin:
        case "synthetic":
            return "Simulated data", "a program computed the samples; no part was measured"
        case "emulated":
            return "Simulated data", "the device is emulated; no part was measured"
        case _:
            return None


def parameter_text(parameter: Parameter) -> str:
    """Return one number of an effect with its interval and its unit.

    >>> parameter_text(Parameter(0.00274, 0.00264, 0.00283, "dps"))
    '2.74 [2.64, 2.83] mdps'
    """
    if isinstance(parameter.value, str):
        return parameter.value
    return symbols(measured(parameter.value, parameter.lower, parameter.upper, parameter.unit))
