"""Where a coefficient of the model is not what the record shows by itself.

A reading (`readings`) has no model, so what it is compared with is what the coefficients together
would show there: the deviation at 1 s has flicker noise in it, and its floor white noise and walk.

N is what people compare, so it has to be confirmed by the density, or the line says why it is not:

======================  ===========================================================================
contradicted            the flat band of the density has another level, beyond 3 % and its interval
rounding                the fit takes off what the step of the values adds, and it is not small
not followed            the density has not the form of the fitted model, of whatever N is a part
alone                   no part of a density that would tell is flat: there is nothing to confirm it
======================  ===========================================================================

The last three need no reading, and hold for a record that is too short to be searched as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from allanscope.analysis.finding_phrases import with_article
from allanscope.analysis.result import ModelCurve, Reading
from allanscope.explain import Effect
from allanscope.noise import Coefficient
from allanscope.noise.whiteness import Bands
from allanscope.quantities import COEFFICIENTS, duration, number, symbols

__all__ = ["disagreement"]
_NOTICEABLE = 0.03
"""Relative difference that needs no explanation."""
_REJECTED = 1e-4
"""Probability of the whitened spectrum below which a density does not follow a model: white noise
of 2,000 samples, fitted, has one below 1e-2 in 1.5 % of records."""
_MUCH = 0.3
"""Share of a deviation that tells where it comes from."""
_SHAPES: Mapping[str, Callable[[float], float]] = {
    "N": lambda tau: 1 / tau,
    "B": lambda _: 2 * math.log(2) / math.pi,
    "K": lambda tau: tau / 3,
    "R": lambda tau: tau**2 / 2,
}
"""Allan variance of each coefficient of size 1 at tau in s."""


def disagreement(
    unit: str,
    coefficients: Mapping[str, Coefficient],
    readings: Mapping[str, Reading],
    effects: Iterable[Effect] = (),
    rounding: float = 0.0,
    model: ModelCurve | None = None,
    bands: Bands | None = None,
    *,
    tells_flat: bool = False,
) -> str | None:
    """Return the line for the first coefficient that its reading contradicts, N before B before K.

    An N that no reading contradicts comes before B, too, where nothing confirms it.

    Parameters
    ----------
    unit : str
        Of the axis.
    coefficients, readings : mapping
        By name; see `readings.read_axis`.
    effects : iterable of Effect
        What was accepted on the axis, from which the cause is taken.
    rounding : float
        White noise per sqrt(Hz) that is rounding, which a reading cannot tell from N: it is the
        cause where N alone would disagree, and forgiven of every other reading.
    model : ModelCurve, optional
        What each effect adds to the curve that was read.
    bands : Bands, optional
        Whitened spectrum of the fit.
    tells_flat : bool
        Whether a flat part of the density would have been seen; see `readings.tells_flat`.
    """
    effects = tuple(effects)
    contradicted = {
        name: _contradicted(unit, name, coefficients, reading, effects, rounding, model)
        for name, reading in readings.items()
    }
    of_white = [line for name, line in contradicted.items() if name[0] == "N" and line]
    others = [line for name, line in contradicted.items() if name[0] != "N" and line]
    if "N" in coefficients and not of_white:
        is_alone = tells_flat and "N" not in readings
        line = _unconfirmed(unit, coefficients["N"], rounding, bands, is_alone=is_alone)
        of_white = [line] if line else []
    return next(iter(of_white + others), None)


def _contradicted(
    unit: str,
    name: str,
    coefficients: Mapping[str, Coefficient],
    reading: Reading,
    effects: tuple[Effect, ...],
    rounding: float,
    model: ModelCurve | None,
) -> str | None:
    """Return the line for a coefficient that its reading contradicts; None where it does not."""
    letter = name[:1]
    known = coefficients.get(letter)
    if known is None:
        return None
    rounded = _agree(name, coefficients, reading, rounding)
    if rounded and (name != "N" or _agree(name, coefficients, reading, 0.0)):
        return None
    near = tuple(
        one
        for one in effects
        if _is_near(one, reading.band_hz)
        and not (one.traits.is_coupling and _is_coupled_little(known))
    )
    more = reading.value > known.value
    cause = _largest(name, reading, near, model, more=more) or _cause(name, near, more=more)
    cause = "the step of the values" if rounded else cause
    usual = COEFFICIENTS[unit, letter][0]
    fitted = number(known.value * usual.factor) if known.detected else usual.limit(known.upper)
    return symbols(
        f"{letter} is {number(reading.value * usual.factor)} {usual.unit} from "
        f"{_how(name, reading)} but {fitted} from the fit; cause: {cause}"
    )


def _unconfirmed(
    unit: str, known: Coefficient, rounding: float, bands: Bands | None, *, is_alone: bool
) -> str | None:
    """Return the line for an N that no reading contradicts but the density does not confirm."""
    usual = COEFFICIENTS[unit, "N"][0]
    fitted = number(known.value * usual.factor) if known.detected else usual.limit(known.upper)
    rounded = math.hypot(known.value, rounding)
    if known.detected and rounded > (1 + _NOTICEABLE) * known.value:
        return symbols(
            f"N is {number(rounded * usual.factor)} {usual.unit} with the rounding of the values "
            f"but {fitted} from the fit; cause: the step of the values"
        )
    begin = f"N is {fitted} {usual.unit} from the fit"
    worst = None if bands is None else _worst(bands)
    if bands is not None and worst is not None:
        return symbols(
            f"{begin}, which the density does not follow: it is {number(bands.ratio[worst], 2)} "
            f"times the model at {number(bands.frequency[worst], 2)} Hz"
        )
    if known.detected and is_alone:
        return symbols(f"{begin} alone: no part of the density is flat")
    return None


def _worst(bands: Bands) -> int | None:
    """Return the band in which a density that does not follow the model is farthest from it.

    None where it follows, or is nowhere off by what would be noticed of N: power is its square.
    """
    noticed = np.abs(bands.ratio - 1) > 2 * _NOTICEABLE
    if bands.p_value() > _REJECTED or not noticed.any():
        return None
    return int(np.argmax(np.where(noticed, np.abs(bands.z), 0.0)))


def _how(name: str, reading: Reading) -> str:
    """Return what a reading was taken from."""
    match name:
        case "N" if reading.band_hz is not None:
            low, high = reading.band_hz
            return f"the density between {number(low, 2)} and {number(high, 2)} Hz"
        case "N_1s":
            return "the deviation at 1 s"
        case "B":
            return f"the minimum deviation (at {duration(reading.tau_s or 0.0)})"
        case _:
            return f"the deviation at {duration(reading.tau_s or 0.0)}"


def _agree(
    name: str, coefficients: Mapping[str, Coefficient], reading: Reading, rounding: float
) -> bool:
    """Return whether coefficient, or all of them together, and reading agree within intervals.

    N has to be what the density shows but for its sampling error, however little the fit knows.
    """
    one = coefficients[name[:1]]
    if name == "N" and one.detected:
        half = (reading.upper - reading.lower) / 2
        if (
            abs(math.hypot(one.value, rounding) - reading.value)
            > _NOTICEABLE * reading.value + half
        ):
            return False
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
    """Return whether two intervals overlap, or miss each other by too little to mention."""
    room = 1 + _NOTICEABLE
    return low <= other_high * room and other_low <= high * room


def _largest(
    name: str,
    reading: Reading,
    effects: tuple[Effect, ...],
    model: ModelCurve | None,
    *,
    more: bool,
) -> str:
    """Return the effect that adds most to a curve where it was read; empty where none adds much.

    To a density nothing is added where it is lower than the coefficient (not `more`).

    What stands beside a filter is the white noise behind it, which is N and not its cause.
    """
    tau = reading.tau_s
    if more and reading.band_hz is not None:  # where the deviation is what is in the band
        tau = 0.5 / math.sqrt(math.prod(reading.band_hz))
    if model is None or tau is None or not model.x[0] <= tau <= model.x[-1]:
        return ""
    read = reading.value * math.sqrt(_SHAPES[name[0]](tau))
    added = {
        effect.kind: float(np.interp(tau, model.x, model.components[effect.kind]))
        for effect in effects
        if effect.kind in model.components and "cutoff" not in effect.parameters
    }
    kind = max(added, key=added.__getitem__, default="")
    if not kind or added[kind] < _MUCH * read:
        return ""
    same = [effect for effect in effects if effect.kind == kind]
    return _phrase(max(same, key=_held))


def _cause(name: str, effects: tuple[Effect, ...], *, more: bool) -> str:
    """Return what explains the difference; `more` where the reading is above the coefficient.

    That is the effect of the largest share among those that act at the averaging times of the
    reading; a low-pass explains no reading that is too large.
    """
    known = [
        one
        for one in effects
        if not (one.traits.of_the_stream or (more and "cutoff" in one.parameters))
    ]
    is_fast = name[0] == "N"
    acting = [one for one in known if (one.traits.acts_fast if is_fast else one.traits.acts_slow)]
    return _phrase(max(acting or known, key=_held)) if known else "not identified"


def _held(effect: Effect) -> float:
    """Return the share of an effect; 0 where it is not known."""
    return effect.share if math.isfinite(effect.share) else 0.0


def _is_coupled_little(known: Coefficient) -> bool:
    """Return whether what other axes bring, which is known, is too little to mention."""
    alone = known.decoupled
    return alone is not None and known.value <= (1 + _NOTICEABLE) * alone.value


def _is_near(effect: Effect, band_hz: tuple[float, float] | None) -> bool:
    """Return whether an effect that has a frequency acts within an octave of where N was read."""
    place = effect.parameters.get("frequency") or effect.parameters.get("cutoff")
    if band_hz is None or place is None or isinstance(place.value, str):
        return True
    above_the_low_end = place.value >= band_hz[0] / 2 or "cutoff" in effect.parameters
    return above_the_low_end and place.value <= 2 * band_hz[1]


def _phrase(effect: Effect) -> str:
    """Return an effect as a cause."""
    words = effect.traits.as_cause or with_article(effect.traits)
    values = {name: one.value for name, one in effect.parameters.items()}
    return words.format_map(
        {name: one if isinstance(one, str) else number(one) for name, one in values.items()}
    )
