"""Effects that are noise, and those that alter the sensor's own noise.

- First-order Gauss-Markov noise on top of the noise floor: a fluctuation with one memory.
- Noise in a band: a resonance, a wandering line.
- Noise of a free slope between those of white noise, flicker and random walk.
- Random telegraph noise: one defect that switches between two states.
- A white level that is not one level: bursts of activity around a quiet bench.
- The part's own low-pass filter: it shapes the noise floor near half the sample rate.
- A high-pass: the level and what is slow, taken away before the record is made.
- A scale that drifts: the noise of a sensor grows or fades in a straight line.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from allanscope.errors import UsageError
from allanscope.simulator.effects import Apply, Conditions, EffectContext, Parameter, effect

if TYPE_CHECKING:
    from allanscope.simulator.noise import GaussMarkov, Narrowband, PowerLaw

__all__ = [
    "band_limit",
    "gauss_markov",
    "high_pass",
    "narrowband",
    "power_law",
    "random_telegraph",
    "scale_drift",
    "variance_change",
]


def _added(process: GaussMarkov | Narrowband | PowerLaw) -> Apply:
    """Return what adds a process to the samples of an axis."""

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        values += process.take(len(values))

    return apply


@effect(
    "gauss_markov",
    "exponentially correlated noise with one time constant",
    "signal",
    sigma=Parameter("axis", "stationary standard deviation", above=0.0),
    correlation_time=Parameter("s", "to 1/e", above=0.0),
)
def gauss_markov(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add noise that is stationary with autocovariance sigma^2 exp(-|t| / correlation_time)."""
    from allanscope.simulator.noise import GaussMarkov

    process = GaussMarkov(
        parameters["sigma"], parameters["correlation_time"], context.rate_hz, context.rng
    )
    return _added(process)


@effect(
    "narrowband",
    "noise in a band around one frequency",
    "signal",
    frequency=Parameter("Hz", "of the resonance", above=0.0),
    bandwidth=Parameter("Hz", "full width at half height", above=0.0),
    sigma=Parameter("axis", "stationary standard deviation", above=0.0),
)
def narrowband(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add the solution of x'' + 2 pi bandwidth x' + (2 pi frequency)^2 x = white noise."""
    from allanscope.simulator.noise import Narrowband

    process = Narrowband(
        parameters["frequency"],
        parameters["bandwidth"],
        parameters["sigma"],
        context.rate_hz,
        context.rng,
    )
    return _added(process)


@effect(
    "power_law",
    "noise whose density falls as f to minus an exponent",
    "signal",
    exponent=Parameter("", "between 0 (white) and 2 (random walk)", above=0.0, most=2.0),
    density=Parameter("axis/sqrt(Hz)", "at 1 Hz, as N is", above=0.0),
)
def power_law(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add white noise integrated exponent / 2 times: density^2 (f / 1 Hz)^-exponent."""
    from allanscope.simulator.noise import PowerLaw

    h = parameters["density"] ** 2
    process = PowerLaw(-parameters["exponent"], h, context.rate_hz, context.rng)
    return _added(process)


@effect(
    "random_telegraph",
    "switching between two levels at random times",
    "signal",
    amplitude=Parameter("axis", "half the distance between the levels", above=0.0),
    dwell=Parameter("s", "mean time in one level", above=0.0),
)
def random_telegraph(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Add y(t) = +-amplitude, switching after exponentially distributed times of mean `dwell`.

    Seen at the samples it is a Markov chain that has switched since the sample before with
    probability (1 - exp(-2 t0 / dwell)) / 2. Its autocovariance amplitude^2 exp(-2 |t| / dwell) is
    that of Gauss-Markov noise of correlation time dwell / 2: no spectrum tells the two apart.
    """
    amplitude, rng = parameters["amplitude"], context.rng
    switch = -0.5 * np.expm1(-2.0 / (context.rate_hz * parameters["dwell"]))
    level = int(rng.integers(2))

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        nonlocal level
        states = (level + np.cumsum(rng.random(len(values)) < switch)) & 1
        level = int(states[-1])
        values += amplitude * (2.0 * states - 1.0)

    return apply


@effect(
    "variance_change",
    "stretches of time in which the white noise is larger",
    "white",
    intervals=Parameter("1", "number of noisy stretches", above=0.0),
    ratio=Parameter("1", "of the standard deviations", default=2.0, above=0.0),
    length=Parameter("s", "of each; 0 for a quarter of its share", 0.0, least=0.0),
)
def variance_change(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Make the white noise `ratio` times as large within each of `intervals` stretches of time.

    The record is cut into as many equal parts; each has one noisy stretch of `length` (a quarter of
    the part when 0) at a random place. AVAR keeps its slope of -1 and shows the mean square.
    """
    count = int(parameters["intervals"])
    part = max(context.duration_s - context.onset_s, 0.0) / max(count, 1)
    length = min(parameters["length"] or part / 4.0, part)
    offsets = context.rng.uniform(0.0, part - length, count)
    begins = context.onset_s + part * np.arange(count) + offsets
    gain = parameters["ratio"] - 1.0

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        inside = np.searchsorted(begins, conditions.time_s, side="right") - np.searchsorted(
            begins + length, conditions.time_s, side="right"
        )
        values *= 1.0 + gain * inside

    return apply


@effect(
    "band_limit",
    "low-pass of the noise floor",
    "noise",
    cutoff=Parameter("Hz", "-3 dB", above=0.0),
)
def band_limit(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Filter by a second-order Butterworth low-pass, -3 dB at the cutoff (bilinear, prewarped).

    It acts on the sensor's own noise (N, B, K) and on nothing that is added as an effect, so that
    an amplitude is always that of the record. N is the level below the cutoff.
    """
    return _butterworth("band_limit", "lowpass", 2, parameters["cutoff"], context)


@effect(
    "high_pass",
    "high-pass of the noise floor",
    "noise",
    corner=Parameter("Hz", "-3 dB", above=0.0),
)
def high_pass(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Take off what an exponential average follows: a first-order high-pass, -3 dB at the corner.

    As `band_limit` it acts on the sensor's own noise alone. N is the level above the corner.
    """
    return _butterworth("high_pass", "highpass", 1, parameters["corner"], context)


def _butterworth(
    kind: str, form: Literal["lowpass", "highpass"], order: int, hz: float, context: EffectContext
) -> Apply:
    from scipy.signal import butter, sosfilt

    if hz >= context.rate_hz / 2.0:
        name = "cutoff" if form == "lowpass" else "corner"
        raise UsageError(
            f"effect {kind}: a {name} of {hz:g} Hz must be below half the sample rate, "
            f"{context.rate_hz / 2.0:g} Hz"
        )
    sections = butter(order, hz, form, fs=context.rate_hz, output="sos")
    carry = np.zeros((len(sections), 2))

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        values[:], carry[:] = sosfilt(sections, values, zi=carry)

    return apply


@effect(
    "scale_drift",
    "a linear drift of the scale factor, of white and slow noise alike",
    "noise",
    relative=Parameter("1", "change of the scale at the end of the record", least=-1.0),
)
def scale_drift(parameters: Mapping[str, float], context: EffectContext) -> Apply:
    """Multiply by s(t) = 1 + relative (t - onset) / T, T the time from the onset to the end."""
    length = max(context.duration_s - context.onset_s, 1.0 / context.rate_hz)
    slope = parameters["relative"] / length

    def apply(values: NDArray[Any], conditions: Conditions) -> None:
        values *= 1.0 + slope * (conditions.time_s - context.onset_s)

    return apply
