"""What the reader of a result must know of a run and of each axis, one sentence each.

**The rate of the rows**: a reader that is faster or slower than the sensor. Stock firmware reads
the sensor in a loop of its own, 50 times a second. A sensor that makes fewer samples is read twice
now and then, and rows repeat; one that makes more is read too seldom, and samples are skipped.
Repeated rows are seen in the values, by the effect ``repeated_samples``. Skipped ones leave no
trace in the values, only in the rate. Where it is far from what the sensor is set to, no oscillator
could be off by so much. Where it is near, 50 rows of a sensor set to 52 Hz, the oscillator could;
but then it would be off by just so much that rows come with the period of a timer, whole multiples
of 5 ms, as exactly as a crystal. By chance one in two hundred does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import median

from allanscope.analysis.analyser import Analyser, StreamState
from allanscope.analysis.result import AxisAnalysis, Rate
from allanscope.clock import DISAGREEMENT
from allanscope.noise import resolution_advice
from allanscope.parts import ACCEL_SCALES, GYRO_SCALES, OSCILLATOR_TOLERANCE
from allanscope.quantities import GRAVITY, SENSOR_NAMES, number
from allanscope.samples import unit_of

__all__ = ["axis_remarks", "run_remarks", "sampling_remarks", "scale_remarks"]

_FITS = 0.02
"""Relative error of a step that is read off values which were printed with few digits."""

_OF_CODES = 0.005
"""The same of full scale / 32768, which is 13 % off what these parts have."""

_PRINTED = 1e-3
"""A step this near to a power of ten is that of the digits, and says nothing of the sensor."""

_FEWEST_AXES = 2

_SETTLING_S = 5.0
"""The rate is rarely measured before: that it is not known yet is no remark."""

_START_S = 0.1
"""A computer that starts a run may read this late, and catch up: over a few seconds that looks like
a clock that differs by thousands of ppm."""


def axis_remarks(state: StreamState, column: int) -> tuple[str, ...]:
    """Return what stands out in the samples of one axis."""
    out = []
    if state.samples and state.lowest[column] == state.highest[column]:
        unit = unit_of(state.info.axes[column])
        step = state.info.scale[column] if state.counted else 0.0
        words = resolution_advice(unit, step, constant=True)
        held = "counts" if state.counted else unit
        out.append(f"constant at {state.lowest[column]:g} {held}: {words}")
    if state.saturated[column]:
        out.append(f"saturated: {state.saturated[column]} samples at the end of the range")
    return tuple(out)


def run_remarks(analyser: Analyser, state: StreamState, rate: Rate) -> tuple[str, ...]:
    """Return what stands out in the run as a whole."""
    out = list(state.padding.remarks(rate.best_hz or 1.0))
    others = [one for one in analyser.configurations if one is not state and one.samples]
    if others:
        out.append(
            f"The device changed its configuration: {sum(one.samples for one in others)} samples "
            "of other configurations are recorded but not part of this result."
        )
    if state.watch_failure:
        out.append(
            f"Event detection failed ({state.watch_failure}): later events are missing; please "
            "report it."
        )
    if rate.measured_hz is None and state.samples > _SETTLING_S * (rate.nominal_hz or 1.0):
        out.append("The true sample rate is not known: averaging times use the nominal rate.")
    apart_ppm = rate.device_against_host_ppm
    least_ppm = 1e6 * max(DISAGREEMENT, _START_S / max(rate.span_s or 0.0, _START_S))
    if rate.source == "device" and apart_ppm is not None and abs(apart_ppm) > least_ppm:
        out.append(
            f"The clocks of the device and the computer differ by {number(abs(apart_ppm), 2)} ppm, "
            "perhaps because the computer reads late; the rate is that of the device's clock."
        )
    return (*out, *dict.fromkeys(analyser.errors[-5:]))


def scale_remarks(steps: Mapping[str, float], part: str) -> tuple[str, ...]:
    """Return what to say of values in dps and g whose step no full scale of the part has.

    Libraries that divide the full scale by 32768 read a gyroscope of these parts 12.8 % low: at
    2000 dps a count is 70 mdps and not 61.

    Parameters
    ----------
    steps : mapping of str to float
        Axis to the step of its values in dps or g; 0 where none shows.
    part : str
        The part that the user named.

    Examples
    --------
    >>> scale_remarks({"gx": 2000 / 32768, "gy": 2000 / 32768}, "LSM6DSL")[0].partition(";")[0]
    'The values of the gyroscope are multiples of 61.04 mdps, which is 2000 dps / 32768'
    >>> scale_remarks({"gx": 0.07, "gy": 0.07}, "LSM6DSL")
    ()
    """
    out = []
    for letter, sensor, unit, table in (
        ("g", "gyroscope", "dps", GYRO_SCALES),
        ("a", "accelerometer", "g", ACCEL_SCALES),
    ):
        own = [step for axis, step in steps.items() if axis[0] == letter and step > 0.0]
        step = median(own) if own else 0.0
        alike = sum(abs(one / step - 1.0) < _FITS for one in own)
        if alike >= _FEWEST_AXES and (words := _scale_words(step, unit, table, part)):
            out.append(f"The values of the {sensor} are multiples of {words}")
    return tuple(out)


def _scale_words(step: float, unit: str, table: Mapping[float, float], part: str) -> str:
    """Return how a step differs from those of a part; empty where it does not, or does not tell."""
    doublings = [step / (scale * k) for scale in table.values() for k in (1, 2, 4)]
    if any(abs(ratio - 1.0) < _FITS for ratio in doublings) or _is_of_digits(step, unit):
        return ""
    value = f"{number(1e3 * step, 4)} m{unit}"
    for full, scale in table.items():
        if abs(step * 32768.0 / full - 1.0) < _OF_CODES:
            step, value = full / 32768.0, f"{number(1e3 * full / 32768.0, 4)} m{unit}"
            return (
                f"{value}, which is {full:g} {unit} / 32768; a count of the {part} is "
                f"{number(1e3 * scale, 4)} m{unit} at {full:g} {unit}: they are "
                f"{number(100.0 * (1.0 - step / scale), 3)} % low, and so is the noise. Multiply "
                f"them by {number(scale / step, 4)}."
            )
    full = min(table, key=lambda one: abs(math.log(table[one] / step)))
    if not 0.5 < table[full] / step < 2.0:
        return ""
    return (
        f"{value}, a step that no full scale of the {part} has; the nearest is "
        f"{number(1e3 * table[full], 4)} m{unit} at {full:g} {unit}. If that is the one, multiply "
        f"them by {number(table[full] / step, 4)}."
    )


def _is_of_digits(step: float, unit: str) -> bool:
    """Return whether a step is a power of ten in any unit that it may have been written in."""
    other = math.radians(1.0) if unit == "dps" else GRAVITY
    exponents = (math.log10(written) for written in (step, step * other))
    return any(abs(exponent - round(exponent)) < _PRINTED for exponent in exponents)


TIMER_MS = 5
"""Firmware that reads a sensor by a timer does so every 10, 20 or 40 ms."""

CRYSTALS = 3e-4
"""By how much the clock of a timer and the one that it is measured with may differ, and more."""


def sampling_remarks(
    axes: Mapping[str, AxisAnalysis], rate: Rate, offered_hz: Sequence[float] = ()
) -> tuple[str, ...]:
    """Return what to say about rows that repeat and samples that were skipped.

    Parameters
    ----------
    axes : mapping of str to AxisAnalysis
        What was found on each.
    rate : Rate
        Claimed and measured.
    offered_hz : sequence of float
        Rates that the sensor can be set to, ascending, where the nominal rate is only the rate of
        the rows of firmware that reads it by a timer.
    """
    out = []
    repeated = _repeated(axes)
    for share, sensors in repeated.items():
        made = rate.best_hz * (1.0 - share)
        out.append(
            f"{number(100 * share, 2)} % of the rows repeat the row before: "
            f"{number(rate.best_hz, 4)} rows arrive per second, but the {' and '.join(sensors)} "
            f"made only about {number(made, 4)} samples."
        )
    if rate.measured_hz is None or not rate.nominal_hz:
        return tuple(out)
    share = rate.measured_hz / rate.nominal_hz
    rows = f"{number(rate.measured_hz, 4)} rows arrive per second"
    if share < 1.0 - OSCILLATOR_TOLERANCE:
        out.append(
            f"{rows} of a sensor set to {number(rate.nominal_hz, 4)} Hz: the reader is slower than "
            f"the sensor and reads one sample in {number(1.0 / share, 3)}; noise above half the "
            "reading rate is aliased."
        )
    elif share > 1.0 + OSCILLATOR_TOLERANCE and not repeated:
        out.append(
            f"{rows} although the sensor is set to {number(rate.nominal_hz, 4)} Hz, and no row "
            "repeats: the sensor is set to another rate."
        )
    elif _unrepeated(axes) and (words := _skipped(rate, offered_hz)):
        out.append(f"{rows}, {words}")
    return tuple(out)


def _skipped(rate: Rate, offered_hz: Sequence[float]) -> str:
    """Return what is skipped of a sensor that is little faster than its reader; empty if nothing.

    >>> at_50 = Rate(52.0, measured_hz=50.0004, uncertainty_ppm=20.0)
    >>> _skipped(at_50, ()).partition(": ")[2]
    'about 3.8 % of the samples of a sensor set to 52.00 Hz are never sent (skipped).'
    >>> _skipped(Rate(52.0, measured_hz=50.2, uncertainty_ppm=20.0), ())
    ''
    """
    assert rate.measured_hz is not None
    timers = 1e3 / rate.measured_hz / TIMER_MS
    known = (rate.uncertainty_ppm or 0.0) * 1e-6 < CRYSTALS / 3.0
    if not known or round(timers) < 1 or abs(timers / round(timers) - 1.0) > CRYSTALS:
        return ""
    above_hz = rate.measured_hz * (1.0 + CRYSTALS)
    claimed = rate.nominal_hz > above_hz
    faster = [rate.nominal_hz] if claimed else [hz for hz in offered_hz if hz > above_hz]
    if not faster or rate.measured_hz / faster[0] < 1.0 - OSCILLATOR_TOLERANCE:
        return ""
    share = number(100.0 * (1.0 - rate.measured_hz / faster[0]), 2)
    period_ms = TIMER_MS * round(timers)
    setting = f"a sensor set to {number(faster[0], 4)} Hz"
    if claimed:
        return (
            f"in step with a timer of {period_ms} ms and not with the sensor: about {share} % of "
            f"the samples of {setting} are never sent (skipped)."
        )
    return (
        f"in step with a timer of {period_ms} ms, a rate that the sensor does not have: about "
        f"{share} % of the samples of {setting} are never sent (skipped), more if it is faster."
    )


def _unrepeated(axes: Mapping[str, AxisAnalysis]) -> bool:
    """Whether repeated rows were looked for, and none found: only then may samples be skipped."""
    looked = [axis for axis in axes.values() if axis.explanation is not None]
    return bool(looked) and not _repeated(axes)


def _repeated(axes: Mapping[str, AxisAnalysis]) -> dict[float, list[str]]:
    """Return the largest share of repeated rows that the loop found on each sensor: whose it is."""
    largest: dict[str, float] = {}
    for name, axis in axes.items():
        for effect in axis.explanation.effects if axis.explanation is not None else ():
            if effect.traits.repeats_rows:
                sensor = SENSOR_NAMES[unit_of(name)]
                share = float(effect.parameters["fraction"].value)
                largest[sensor] = max(share, largest.get(sensor, 0.0))
    whose: dict[float, list[str]] = {}
    for sensor, share in largest.items():
        whose.setdefault(share, []).append(sensor)
    return whose
