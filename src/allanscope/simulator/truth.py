"""What a simulated sensor is: noise coefficients, effects, temperature. The truth to be found."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from allanscope.errors import AllanscopeError, InputError, UsageError
from allanscope.parts import part_named
from allanscope.samples import AXES
from allanscope.simulator.effect_spec import GROUPS, EffectSpec, parse_effect
from allanscope.simulator.noise import stream
from allanscope.simulator.parameters import Parameter, number

__all__ = ["AxisTruth", "TemperatureTruth", "Truth"]

_SQRT2 = 2.0**0.5
_UNPUBLISHED_GYRO_DENSITY = 5e-3
_UNPUBLISHED_ACCEL_DENSITY = 90e-6


_LARGEST = 1e9
"""In the units of a coefficient: no sensor, and its square is still a number."""


@dataclass(frozen=True, slots=True)
class AxisTruth:
    """Noise of one axis in the conventions of IEEE 952, two-sided, and its level.

    Attributes
    ----------
    N : float
        White noise, unit/sqrt(Hz).
    B : float
        Flicker, unit; the floor of ADEV is 0.664 B.
    B_dt0064 : float
        Flicker made by the generator of ST's design tip DT0064, unit.
    K : float
        Random walk, unit/sqrt(s).
    Q, P : float
        White and flicker angle noise, unit s.
    F, D : float
        Flicker walk, unit/s, and random run, unit/s^1.5.
    R : float
        Ramp, unit/s, signed.
    offset : float
        Level, unit.
    """

    N: float = 0.0
    B: float = 0.0
    K: float = 0.0
    Q: float = 0.0
    R: float = 0.0
    offset: float = 0.0
    P: float = 0.0
    F: float = 0.0
    D: float = 0.0
    B_dt0064: float = 0.0

    def __post_init__(self) -> None:
        for name in ("N", "B", "K", "Q", "P", "F", "D", "B_dt0064"):
            number("truth", name, getattr(self, name), Parameter("", "", least=0.0, most=_LARGEST))


@dataclass(frozen=True, slots=True)
class TemperatureTruth:
    """The temperature of the sensor: a room that wanders, self-heating, and a noisy thermometer.

    Attributes
    ----------
    start_c : float
        At power-on.
    wander_c, wander_s : float
        Standard deviation and correlation time of the room (first-order Gauss-Markov).
    self_heating_c, self_heating_s : float
        Final rise above the room and its time constant.
    sensor_noise_c : float
        White noise of each reading.
    """

    start_c: float = 25.0
    wander_c: float = 0.3
    wander_s: float = 2000.0
    self_heating_c: float = 2.5
    self_heating_s: float = 300.0
    sensor_noise_c: float = 0.02


@dataclass(frozen=True, slots=True)
class Truth:
    """All that a fit could find out about a simulated sensor.

    Attributes
    ----------
    axes : mapping
        Axis to its noise; an axis that is not there is silent.
    effects : tuple of EffectSpec
        What the textbook model lacks.
    temperature : TemperatureTruth
        Of the sensor.
    """

    axes: Mapping[str, AxisTruth]
    effects: tuple[EffectSpec, ...] = ()
    temperature: TemperatureTruth = field(default_factory=TemperatureTruth)

    @classmethod
    def typical(cls, part: str = "LSM6DSM", seed: int = 0) -> Truth:
        """Return a plausible sensor: densities of the datasheet, levels drawn from its tolerance.

        The white noise is the typical density of the datasheet over sqrt(2), because that is
        one-sided (where ST publishes none: 5 mdps and 90 ug/sqrt(Hz)). Flicker and random walk are
        in no datasheet; the values are those of good specimens: 1 mdps and 0.1 mdps/sqrt(s), 30 ug
        and 2 ug/sqrt(s). There are no effects: what the model calls clean is clean.

        Examples
        --------
        >>> round(Truth.typical().axes["gx"].N * 2**0.5, 6)
        0.0038
        """
        known = part_named(part)
        accel = known.accel_density or {2.0: _UNPUBLISHED_ACCEL_DENSITY}
        gyro = known.gyro_density or _UNPUBLISHED_GYRO_DENSITY
        rng = stream(seed, "levels")
        dps, g = known.zero_rate_dps or 3.0, known.zero_g_g or 0.04
        axes = {
            axis: AxisTruth(N=gyro / _SQRT2, B=1e-3, K=1e-4, offset=dps * rng.uniform(-1, 1))
            for axis in AXES[:3]
        } | {
            axis: AxisTruth(N=accel[2.0] / _SQRT2, B=30e-6, K=2e-6, offset=g * rng.uniform(-1, 1))
            for axis in AXES[3:]
        }
        axes["az"] = replace(axes["az"], offset=1.0 + axes["az"].offset)
        return cls(axes)

    @classmethod
    def from_result(cls, result: Mapping[str, Any]) -> Truth:
        """Return the sensor that a result of ``allanscope analyse`` describes.

        Each axis has ``coefficients`` (N, B, K, Q, R, each plain or ``{"value": ...}``), and may
        have ``effects`` and ``level``. A coefficient that was not detected is left out, and so is
        an effect that is ``unexplained``, or from which its axis was not cleaned. The measured
        rate becomes a clock error.

        Raises
        ------
        InputError
            If the mapping has no axes.
        """
        axes = result.get("axes")
        if not isinstance(axes, Mapping) or not set(axes) <= set(AXES) or not axes:
            raise InputError(f"no sensor to simulate: needs axes, of {' '.join(AXES)}")
        effects: list[EffectSpec] = []
        for name, axis in axes.items():
            effects += (one for one in _effects_of(name, axis) if not _repeats(one, effects))
        effects += _clock_of(result.get("rate") or {})
        return cls({name: _axis(axis) for name, axis in axes.items()}, tuple(effects))

    @classmethod
    def load(cls, path: Path) -> Truth:
        """Return the sensor that a JSON or TOML file describes, see `from_result`.

        Raises
        ------
        InputError
            If the file cannot be read, is neither, or is not built like a result.
        """
        try:
            text = path.read_text("utf-8")
            content = tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"{path}: no JSON or TOML that can be read: {error}") from error
        if not isinstance(content, Mapping):
            raise InputError(f"{path}: no sensor to simulate: must be a table with axes")
        try:
            return cls.from_result(content)
        except AllanscopeError:
            raise
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            raise InputError(f"{path}: no result that could be simulated: {error}") from error

    def with_effects(self, effects: Iterable[EffectSpec | str]) -> Truth:
        """Return this sensor with more effects, given as they are or in words."""
        more = (parse_effect(one) if isinstance(one, str) else one for one in effects)
        return replace(self, effects=self.effects + tuple(more))

    def with_noise(self, specs: Iterable[str]) -> Truth:
        """Return this sensor with other noise: that of ``N=0.003,F=1e-6,axis=gx``, and no other.

        N, B, K, Q, P, F, D and R are coefficients, B_dt0064 that of the design tip's 1/f generator;
        n1 and n2 are those of a first-order Markov process, dx/dt = n1 x + n2 w, which becomes an
        effect. An axis, ``gyro``, ``accel`` or ``all``; gx if none is named. Axes that no text
        names stay as they are.

        Raises
        ------
        UsageError
            For a name or an axis that does not exist, or a number out of range.

        Examples
        --------
        >>> sensor = Truth.typical().with_noise(["K=1e-3", "n1=-0.1,n2=0.01"])
        >>> sensor.axes["gx"].K, sensor.axes["gx"].N, sensor.effects[0].parameters
        (0.001, 0.0, {'sigma': 0.022360679774997897, 'correlation_time': 10.0})
        """
        axes, effects = dict(self.axes), list(self.effects)
        fresh: set[str] = set()
        for text in specs:
            given, group = _noise_of(text)
            markov = {name: given.pop(name) for name in ("n1", "n2") if name in given}
            for axis in group:
                kept = axes.get(axis, AxisTruth())
                start = kept if axis in fresh else AxisTruth(offset=kept.offset)
                axes[axis] = replace(start, **given)
                fresh.add(axis)
                if markov:
                    effects.append(_markov(axis, **markov))
        return replace(self, axes=axes, effects=tuple(effects))

    def effects_on(self, axis: str) -> Iterable[EffectSpec]:
        """Return the effects of one axis in their order."""
        return (effect for effect in self.effects if axis in effect.axes)

    @property
    def clock_error(self) -> float | None:
        """Relative error of the sample rate if there is an effect that gives it, else None."""
        errors = [e.parameters["relative"] for e in self.effects if e.kind == "clock_error"]
        return errors[-1] if errors else None

    @property
    def clock_wander(self) -> tuple[float, float]:
        """Change of the sample rate in ppm/h and ppm/degC; both zero for a steady clock."""
        found = [e.parameters for e in self.effects if e.kind == "clock_error"]
        return (found[-1]["drift"], found[-1]["per_degc"]) if found else (0.0, 0.0)


def _noise_of(text: str) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the numbers and the axes of ``N=0.003,axis=gyro``."""
    names = ("N", "B", "K", "Q", "P", "F", "D", "R", "B_dt0064", "n1", "n2")
    given: dict[str, float] = {}
    axes: tuple[str, ...] = ("gx",)
    for part in text.split(","):
        name, _, value = part.partition("=")
        if name == "axis":
            if value not in GROUPS and value not in AXES:
                choices = " ".join((*AXES, *GROUPS))
                raise UsageError(f"noise {text!r}: unknown axis {value!r}; axes are {choices}")
            axes = GROUPS.get(value, (value,))
            continue
        if name not in names:
            raise UsageError(f"noise {text!r}: unknown {name!r}; write {' '.join(names)} and axis")
        given[name] = number("noise", name, value, Parameter("", ""))
    if not given or ("n1" in given) != ("n2" in given):
        raise UsageError(f"noise {text!r}: write e.g. N=0.003,B=0.001,axis=gx, or n1=-0.1,n2=0.01")
    return given, axes


def _markov(axis: str, n1: float, n2: float) -> EffectSpec:
    """Return the process dx/dt = n1 x + n2 w: correlation time -1/n1, sigma n2 / sqrt(-2 n1)."""
    if not (n1 < 0.0 < n2):
        raise UsageError(f"a Markov process needs n1 < 0 and n2 > 0, got {n1:g} and {n2:g}")
    numbers = {"sigma": n2 / math.sqrt(-2.0 * n1), "correlation_time": -1.0 / n1}
    return EffectSpec("gauss_markov", numbers, (axis,))


def _axis(axis: Mapping[str, Any]) -> AxisTruth:
    given: dict[str, float] = {}
    for name, told in axis.get("coefficients", {}).items():
        # What N has beside its white noise is among the effects.
        entry = (told.get("white_alone") or told) if isinstance(told, Mapping) else told
        found = entry.get("value") if isinstance(entry, Mapping) else entry
        if isinstance(entry, Mapping) and entry.get("detected") is False:
            found = None
        if found is not None and name in {one.name for one in fields(AxisTruth)}:
            given[name] = number("truth", name, found, Parameter("", ""))
    level = axis.get("level") or {}
    mean = float(level.get("mean") or 0.0)
    if not math.isfinite(mean):
        raise ValueError(f"the mean level must be finite, got {mean}")
    return AxisTruth(**{"offset": mean, **given})


def _effects_of(name: str, axis: Mapping[str, Any]) -> Iterable[EffectSpec]:
    for one in axis.get("effects", ()):
        if isinstance(one, str):
            yield replace(parse_effect(one), axes=(name,))
        elif one.get("kind") != "unexplained" and _is_removed(one):
            yield EffectSpec.from_result(name, one)


def _is_removed(effect: Mapping[str, Any]) -> bool:
    """Return whether the axis was cleaned of an effect: of a coupling only one of two may be."""
    evidence = effect.get("evidence")
    return not isinstance(evidence, Mapping) or evidence.get("removed") is not False


def _repeats(effect: EffectSpec, known: Iterable[EffectSpec]) -> bool:
    """Return whether an effect of whole rows or of the clock is known from another axis."""
    return any(
        one.kind == effect.kind and set(effect.axes) <= set(one.axes)
        for one in known
        if one.kind in ("repeated_samples", "clock_error")
    )


def _clock_of(rate: Mapping[str, Any]) -> list[EffectSpec]:
    nominal, measured = rate.get("nominal_hz"), rate.get("measured_hz")
    if not nominal or not measured:
        return []
    return [EffectSpec("clock_error", {"relative": measured / nominal - 1.0})]
