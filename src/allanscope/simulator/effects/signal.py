"""Effects that are added to the output of an axis: motion, disturbances, temperature, other axes.

- A step: the level is another one from one moment on.
- An excursion: the level leaves and comes back, as it does when somebody touches the table.
- A warm-up: an offset that dies away after power-on.
- A shock: something is knocked and rings for a moment.
- A line: vibration, mains pick-up, an alias, a daily cycle.
- A line that drifts: a fan, a pump, a building, whose frequency and amplitude change slowly.
- Outliers: isolated samples far outside the distribution of the rest, as of a mixed read.
- Temperature sensitivity: the axis follows the temperature of the sensor.
- Noise that is as loud as another axis is away from its rest.
- Cross-coupling: one axis shows a share of another.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, Conditions, EffectContext, Parameter, effect

__all__ = [
    "amplitude_coupling",
    "cross_coupling",
    "cycle",
    "drifting_line",
    "excursion",
    "motion",
    "outliers",
    "relaxation",
    "shock",
    "sinusoid",
    "step",
    "temperature",
    "warm_up",
]


@effect(
    "step",
    "a change of the level at one time",
    "signal",
    size=Parameter("axis", "signed"),
)
def step(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add y(t) = size for t >= time, which is the onset that every effect has."""
    size = parameters["size"]

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        values += size

    return apply


@effect(
    "excursion",
    "a level shift that returns",
    "signal",
    duration=Parameter("s", "until the level comes back", above=0.0),
    size=Parameter("axis", "signed"),
)
def excursion(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add y(t) = size for time <= t < time + duration."""
    size, back_s = parameters["size"], context.onset_s + parameters["duration"]

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        values[conditions.time_s < back_s] += size

    return apply


@effect(
    "cycle",
    "a waveform of the level, repeated in cycles whose length wanders",
    "signal",
    period=Parameter("s", "median length of a cycle", above=0.0),
    size=Parameter("axis", "from the lowest level to the highest"),
    scatter=Parameter("1", "standard deviation of the logarithm of the length", 0.1, least=0.0),
)
def cycle(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add y(t) = size / 2 sin(2 pi p + sin(2 pi p) / 2), the phase p one more in each cycle.

    Lengths are drawn one by one; the record begins anywhere in the first cycle.
    """
    size, rng = parameters["size"], context.rng
    begins: list[float] = []

    def next_begin() -> None:
        length = parameters["period"] * np.exp(parameters["scatter"] * rng.standard_normal())
        begins.append(begins[-1] + length if begins else context.onset_s - rng.random() * length)

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        while len(begins) < 2 or begins[-1] <= conditions.time_s[-1]:
            next_begin()
        turn = 2 * np.pi * np.interp(conditions.time_s, begins, range(len(begins)))
        values += size / 2 * np.sin(turn + np.sin(turn) / 2)

    return apply


@effect(
    "relaxation",
    "a jump of the level that relaxes exponentially",
    "signal",
    size=Parameter("axis", "of the jump, signed"),
    time_constant=Parameter("s", "of the relaxation", above=0.0),
    lasting=Parameter("axis", "what stays in the end, signed", 0.0),
)
def relaxation(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add y(t) = lasting + (size - lasting) exp(-(t - time) / time_constant) for t >= time."""
    lasting, time_constant = parameters["lasting"], parameters["time_constant"]
    creep = parameters["size"] - lasting

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        values += lasting + creep * np.exp((context.onset_s - conditions.time_s) / time_constant)

    return apply


@effect(
    "warm_up",
    "an offset that decays exponentially",
    "signal",
    time_constant=Parameter("s", "of the decay", above=0.0),
    amplitude=Parameter("axis", "at its start, signed"),
)
def warm_up(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add y(t) = amplitude exp(-(t - time) / time_constant)."""
    amplitude, time_constant = parameters["amplitude"], parameters["time_constant"]

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        values += amplitude * np.exp((context.onset_s - conditions.time_s) / time_constant)

    return apply


_CYCLES = 6.0
"""Of the ringing within the duration, after which it has decayed to a percent."""
_DECAYS = 4.6


@effect(
    "shock",
    "a mechanical shock that rings",
    "signal",
    duration=Parameter("s", "until it has decayed to a few percent", above=0.0),
    peak=Parameter("axis", "signed"),
)
def shock(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add peak exp(-x) cos(2 pi f t) from the time of the shock on."""
    duration, peak, begin = parameters["duration"], parameters["peak"], context.onset_s

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        t = np.maximum(conditions.time_s - begin, 0.0) / duration
        values += peak * np.exp(-_DECAYS * t) * np.cos(2 * pi * _CYCLES * t)

    return apply


_SWINGS_HZ = (0.3, 0.8, 1.7)
"""Of a hand."""


@effect(
    "motion",
    "the board is carried or turned for a while",
    "signal",
    duration=Parameter("s", "until it lies still again", above=0.0),
    peak=Parameter("axis", "of the swings together", above=0.0),
)
def motion(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add slow swings of random phases from the time of the motion until it is over."""
    duration, peak, begin = parameters["duration"], parameters["peak"], context.onset_s
    phases = context.rng.uniform(0.0, 2.0 * pi, len(_SWINGS_HZ))

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        t = conditions.time_s - begin
        moved = (t >= 0.0) & (t < duration)
        for hertz, phase in zip(_SWINGS_HZ, phases, strict=True):
            values += peak / len(phases) * moved * np.sin(2.0 * pi * hertz * t + phase)

    return apply


@effect(
    "sinusoid",
    "a line at one frequency",
    "signal",
    frequency=Parameter("Hz", "of the line", above=0.0),
    amplitude=Parameter("axis", "peak", above=0.0),
    locked=Parameter("1", "1: of the sensor's own clock", 0.0, least=0.0, most=1.0),
)
def sinusoid(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add y(t) = amplitude sin(2 pi frequency t + phase), the phase drawn at random.

    AVAR(tau) = amplitude^2 sin^4(pi f tau) / (m^2 sin^2(pi f t0)), averaged over the phase.
    A frequency above half the sample rate is folded back, as in a sensor without a filter.
    A line that is locked is made by the sensor's own clock: it goes with the number of the sample.
    """
    amplitude, omega = parameters["amplitude"], 2.0 * pi * parameters["frequency"]
    phase = context.rng.uniform(0.0, 2.0 * pi)

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        time_s = conditions.time_s
        if parameters["locked"]:
            time_s = (conditions.first + np.arange(len(values))) / context.rate_hz
        values += amplitude * np.sin(omega * time_s + phase)

    return apply


_PERIOD_S, _SWELL_S = 610.0, 430.0
"""Of the frequency and of the amplitude; no multiple of each other."""
_SWELL = 0.3
_HOLDS = 0.988
"""Part of its range in which a sine is for 90 % of the time."""


@effect(
    "drifting_line",
    "a line whose frequency and amplitude change slowly",
    "signal",
    frequency=Parameter("Hz", "centre of the range", above=0.0),
    bandwidth=Parameter("Hz", "range of the frequency in 90 % of the time", above=0.0),
    sigma=Parameter("axis", "rms amplitude", above=0.0),
)
def drifting_line(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add a tone whose frequency swings as a sine, for 90 % of the time within the bandwidth.

    The amplitude swells and fades by 30 %, with the rms amplitude sigma over many periods.
    """
    frequency, sigma = parameters["frequency"], parameters["sigma"]
    reach = parameters["bandwidth"] / 2 / _HOLDS
    start, swing, swell = context.rng.uniform(0.0, 2 * pi, 3)
    peak = sigma * sqrt(2 / (1 + _SWELL**2 / 2))

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        t = conditions.time_s
        phase = 2 * pi * frequency * t + start
        phase -= reach * _PERIOD_S * np.cos(2 * pi * t / _PERIOD_S + swing)
        envelope = 1 + _SWELL * np.sin(2 * pi * t / _SWELL_S + swell)
        values += peak * envelope * np.sin(phase)

    return apply


SIGMAS = 20.0


@effect(
    "outliers",
    "isolated outliers",
    "signal",
    count=Parameter("1", "in the whole record", above=0.0),
    size=Parameter("axis", "0 for 20 standard deviations", default=0.0),
)
def outliers(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Displace `count` single samples, spread at random over the record, by +-size.

    Without a size: 20 standard deviations of the white noise, at least 20 counts.
    """
    rng, count = context.rng, int(parameters["count"])
    usual = SIGMAS * max(context.white_sigma, context.lsb)
    size = parameters["size"] or usual
    times = rng.uniform(context.onset_s, max(context.duration_s, context.onset_s), count)
    rows = np.sort(np.floor(times * context.rate_hz).astype(np.int64))
    sizes = size * rng.choice([-1.0, 1.0], count)

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        here = slice(*np.searchsorted(rows, (conditions.first, conditions.first + len(values))))
        values[rows[here] - conditions.first] += sizes[here]

    return apply


@effect(
    "temperature",
    "dependence on the temperature of the sensor",
    "signal",
    slope=Parameter("axis/degC", "change per degree, at 25 degC"),
    curvature=Parameter("axis/degC^2", "change per square of degrees from 25", default=0.0),
    lag=Parameter("s", "time constant with which it follows", default=0.0, least=0.0),
)
def temperature(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add y = slope x + curvature x^2 with x = T - 25 degC, T being true and not its noisy reading.

    With a lag x follows T as lag dx/dt = T - 25 degC - x, in balance when the effect begins.
    """
    import numpy as np
    from scipy.signal import lfilter

    slope, curvature, lag = (parameters[name] for name in ("slope", "curvature", "lag"))
    keep = float(np.exp(-1 / (lag * context.rate_hz))) if lag > 0 else 0.0
    state: list[float] = []

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        warmth = conditions.temperature_c
        if keep and len(warmth):
            before = state.pop() if state else keep * float(warmth[0])
            warmth, after = lfilter([1 - keep], [1.0, -keep], warmth, zi=[before])
            state.append(float(after[0]))
        values += warmth * (slope + curvature * warmth)

    return apply


@effect(
    "amplitude_coupling",
    "noise whose amplitude follows another axis",
    "coupling",
    slope=Parameter("axis/source", "standard deviation of a sample per unit of the source"),
    rest=Parameter("source", "value of the source at which there is none", 0.0),
    takes_source=True,
)
def amplitude_coupling(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add y(t) = slope (x(t) - rest) w, x the source before any coupling, w unit white noise."""
    slope, rest, rng = parameters["slope"], parameters["rest"], context.rng

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        size = slope * (conditions.axes[context.source] - rest)
        values += size * rng.standard_normal(len(values))

    return apply


@effect(
    "cross_coupling",
    "a share of another axis",
    "coupling",
    slope=Parameter("axis/source", "change per unit of the source"),
    takes_source=True,
)
def cross_coupling(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add y(t) = slope x(t), x being the source axis before any coupling, level and all.

    With an accelerometer as the source of a gyro axis this is g-sensitivity.
    """
    slope, source = parameters["slope"], context.source

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        values += slope * conditions.axes[source]

    return apply
