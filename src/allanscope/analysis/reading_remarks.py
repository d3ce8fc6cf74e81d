"""Where a coefficient of the model and its reading off the curve disagree: one line that says why.

A reading has no model, so what it is compared with is what the coefficients together would show
there: the deviation at 1 s has flicker noise in it, and its floor white noise and
walk.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping

from allanscope.analysis.result import Reading
from allanscope.explain import Effect
from allanscope.labels import kind_name
from allanscope.noise import Coefficient
from allanscope.quantities import COEFFICIENTS, duration, number, symbols

__all__ = ["disagreement"]

_NOTICEABLE = 0.03
"""Relative difference below which nobody asks why."""
_SHAPES: Mapping[str, Callable[[float], float]] = {
    "N": lambda tau: 1 / tau,
    "B": lambda _: 2 * math.log(2) / math.pi,
    "K": lambda tau: tau / 3,
    "R": lambda tau: tau**2 / 2,
}
"""Allan variance of each coefficient of size 1 at tau in s."""

_FAST = (
    *(
        "gauss_markov",
        "power_law",
        "random_telegraph",
        "band_limit",
        "outliers",
        "repeated_samples",
    ),
    *("cross_coupling", "variance_change", "scale_drift", "saturation", "narrowband", "sinusoid"),
    *("drifting_line", "dead_zone", "amplitude_coupling"),
    "unexplained",
)
_SLOW = (
    *(
        "gauss_markov",
        "power_law",
        "random_telegraph",
        "shock",
        "step",
        "excursion",
        "warm_up",
        "temperature",
    ),
    *("cross_coupling", "scale_drift", "variance_change", "outliers", "sinusoid", "narrowband"),
    "drifting_line",
    "unexplained",
)
"""Which effects explain a difference at short averaging times and at long ones, likeliest first."""


def disagreement(
    unit: str,
    coefficients: Mapping[str, Coefficient],
    readings: Mapping[str, Reading],
    effects: Iterable[Effect] = (),
    rounding: float = 0.0,
) -> str | None:
    """Return the line for the first coefficient that its reading contradicts, N before B before K.

    Parameters
    ----------
    unit : str
        Of the axis.
    coefficients, readings : mapping
        By name; see `readings.read_axis`.
    effects : iterable of Effect
        What was accepted on the axis, from which the cause is taken.
    rounding : float
        White noise per sqrt(Hz) that is rounding, which a reading cannot tell from N.
    """
    for name, reading in readings.items():
        letter = name[:1]
        known = coefficients.get(letter)
        if known is None or _agree(name, coefficients, reading, rounding):
            continue
        near = tuple(
            one
            for one in effects
            if _is_near(one, reading.band_hz)
            and not (one.kind == "cross_coupling" and _is_coupled_little(known))
        )
        cause = _cause(name, reading.value > known.value, near)
        usual = COEFFICIENTS[unit, letter][0]
        fitted = (
            usual.limit(known.upper) if not known.detected else number(known.value * usual.factor)
        )
        read = number(reading.value * usual.factor)
        return symbols(
            f"{letter} is {read} {usual.unit} from {_how(name, reading)} and {fitted} from the "
            f"fit: {cause}"
        )
    return None


def _how(name: str, reading: Reading) -> str:
    """Return what a reading was taken from."""
    match name:
        case "N" if reading.band_hz is not None:
            low, high = reading.band_hz
            return f"the density from {number(low, 2)} to {number(high, 2)} Hz"
        case "N_1s":
            return "the deviation at 1 s"
        case "B":
            return f"the minimum deviation (at {duration(reading.tau_s or 0.0)})"
        case _:
            return f"the deviation at {duration(reading.tau_s or 0.0)}"


def _agree(
    name: str, coefficients: Mapping[str, Coefficient], reading: Reading, rounding: float
) -> bool:
    """Tell whether coefficient, or all of them together, and reading agree within intervals."""
    one = coefficients[name[:1]]
    low = one.lower if one.detected else 0.0
    if _overlap(low, one.upper, reading.lower, reading.upper):
        return True
    white = math.hypot(low if name[0] == "N" else 0.0, rounding)
    if name == "N":
        return _overlap(white, math.hypot(one.upper, rounding), reading.lower, reading.upper)
    tau = reading.tau_s or 1.0
    # The deviation that was read, and those that the limits of all coefficients make there.
    size = math.sqrt(_SHAPES[name[0]](tau))
    expected = [
        math.sqrt(
            sum(
                shape(tau) * ((found.lower if side == 0 else found.upper) ** 2)
                for letter, shape in _SHAPES.items()
                if (found := coefficients.get(letter)) is not None and math.isfinite(found.upper)
            )
            + rounding**2 / tau
        )
        for side in (0, 1)
    ]
    return _overlap(expected[0], expected[1], reading.lower * size, reading.upper * size)


def _overlap(low: float, high: float, other_low: float, other_high: float) -> bool:
    """Tell whether two intervals overlap, or miss each other by too little to mention."""
    room = 1 + _NOTICEABLE
    return low <= other_high * room and other_low <= high * room


def _cause(name: str, more: bool, effects: tuple[Effect, ...]) -> str:
    """Return what explains the difference; `more` where the reading is above the coefficient."""
    order = _FAST if name[0] == "N" else _SLOW
    known = [e for e in effects if not e.of_the_stream]
    for kind in order:
        found = next((effect for effect in known if effect.kind == kind), None)
        if found is not None and not (kind == "band_limit" and more):
            return _phrase(found)
    other = next((effect for effect in known if effect.kind not in order), None)
    return "not explained by the model" if other is None else _phrase(other)


def _is_coupled_little(known: Coefficient) -> bool:
    """Tell whether what other axes bring, which is known, is too little to mention."""
    alone = known.decoupled
    return alone is not None and known.value <= (1 + _NOTICEABLE) * alone.value


def _is_near(effect: Effect, band_hz: tuple[float, float] | None) -> bool:
    """Tell whether an effect that has a frequency acts within an octave of where N was read."""
    place = effect.parameters.get("frequency") or effect.parameters.get("cutoff")
    if band_hz is None or place is None or isinstance(place.value, str):
        return True
    above_the_low_end = place.value >= band_hz[0] / 2 or "cutoff" in effect.parameters
    return above_the_low_end and place.value <= 2 * band_hz[1]


def _phrase(effect: Effect) -> str:
    """Return an effect as a cause."""
    words = _PHRASES.get(effect.kind)
    if words is None:
        kind = kind_name(effect.kind)
        return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"
    values = {name: one.value for name, one in effect.parameters.items()}
    return words.format_map(
        {name: one if isinstance(one, str) else number(one) for name, one in values.items()}
    )


_PHRASES = {
    "gauss_markov": "the rest is Gauss-Markov noise of {correlation_time} s",
    "power_law": "the rest is noise of density f^-{exponent}",
    "random_telegraph": "the rest is a telegraph signal with a dwell time of {dwell} s",
    "band_limit": "a low-pass at {cutoff} Hz",
    "cross_coupling": "a coupling from {source}",
    "sinusoid": "a line at {frequency} Hz",
    "narrowband": "noise in a band at {frequency} Hz",
    "drifting_line": "a line that drifts around {frequency} Hz",
    "outliers": "outliers",
    "repeated_samples": "repeated samples",
    "saturation": "saturation",
    "dead_zone": "a dead zone",
    "amplitude_coupling": "noise whose amplitude follows {source}",
    "unexplained": "an unexplained part",
}
"""Effects as causes; others by the name of their kind."""
