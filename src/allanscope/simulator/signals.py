"""The physical signals of a sensor before its converters: each axis, and the temperature.

An axis is the sensor's own noise, then the effects on it. The temperature is a room that wanders
and a part that warms itself, read by a noisy thermometer.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effect_spec import EffectSpec
from allanscope.simulator.effects import Apply, Conditions, EffectContext, Run, Stage, effect_kinds
from allanscope.simulator.noise import (
    Flicker,
    FlickerPhase,
    FlickerWalk,
    GaussMarkov,
    OctaveFlicker,
    PowerLaw,
    RandomRun,
    RandomWalk,
    White,
    WhitePhase,
)
from allanscope.simulator.truth import AxisTruth, TemperatureTruth

__all__ = ["AxisSignal", "EffectChain", "Thermometer"]

REFRESH_HZ = 52.0
"""The part renews its temperature register at this rate and holds it in between."""


class EffectChain:
    """The effects of one axis (or of a set of rows), set up and sorted by stage.

    Parameters
    ----------
    specs : iterable of EffectSpec
        In the order in which they act within a stage.
    name : str
        Of the axis; part of the seed of each effect.
    run : Run
        What is the same for all axes.
    white_sigma, lsb : float
        See `EffectContext`.
    """

    def __init__(
        self,
        specs: Iterable[EffectSpec],
        name: str,
        run: Run,
        white_sigma: float = 0.0,
        lsb: float = 1.0,
    ) -> None:
        self._stages: dict[Stage, list[tuple[float, Apply]]] = {}
        for number, spec in enumerate(specs):
            kind = effect_kinds()[spec.kind]
            context = EffectContext(
                rate_hz=run.rate_hz,
                duration_s=run.duration_s,
                onset_s=spec.time,
                white_sigma=white_sigma,
                lsb=lsb,
                source=spec.source,
                rng=run.stream(name, spec.kind, str(number)),
            )
            apply = kind.set_up(spec.parameters, context)
            self._stages.setdefault(kind.stage, []).append((spec.time, apply))

    def apply(self, stage: Stage, values: NDArray[np.generic], conditions: Conditions) -> None:
        """Let all effects of a stage act, each from its onset on."""
        for onset_s, effect in self._stages.get(stage, ()):
            rows = int(np.searchsorted(conditions.time_s, onset_s))
            if rows == 0:
                effect(values, conditions)
            elif rows < len(values):
                effect(values[rows:], conditions.after(rows))

    def has(self, stage: Stage) -> bool:
        """Return whether any effect acts at a stage."""
        return stage in self._stages


class AxisSignal:
    """A stream of the physical signal of one axis.

    Parameters
    ----------
    axis : str
        Its name; part of the seed of every process.
    truth : AxisTruth
        Coefficients; a process whose coefficient is zero does not exist.
    effects : iterable of EffectSpec
        On this axis.
    run : Run
        What is the same for all axes.
    lsb : float
        Unit per count.
    """

    def __init__(
        self,
        axis: str,
        truth: AxisTruth,
        effects: Iterable[EffectSpec],
        run: Run,
        lsb: float,
    ) -> None:
        self._truth = truth
        rate = run.rate_hz
        self._white = White(truth.N, rate, run.stream(axis, "white"))
        self._slow: list[PowerLaw | OctaveFlicker] = []
        if truth.B:
            self._slow.append(Flicker(truth.B, rate, run.stream(axis, "flicker")))
        if truth.B_dt0064:
            octaves = run.stream(axis, "flicker in octaves")
            self._slow.append(OctaveFlicker(truth.B_dt0064, rate, octaves))
        if truth.K:
            self._slow.append(RandomWalk(truth.K, rate, run.stream(axis, "random walk")))
        if truth.F:
            self._slow.append(FlickerWalk(truth.F, rate, run.stream(axis, "flicker walk")))
        if truth.D:
            self._slow.append(RandomRun(truth.D, rate, run.stream(axis, "random run")))
        self._angle: list[PowerLaw] = []
        if truth.Q:
            self._angle.append(WhitePhase(truth.Q, rate, run.stream(axis, "angle")))
        if truth.P:
            self._angle.append(FlickerPhase(truth.P, rate, run.stream(axis, "flicker angle")))
        self.effects = EffectChain(effects, axis, run, self._white.sigma, lsb)

    def take(self, conditions: Conditions) -> NDArray[np.float64]:
        """Return the next samples, as many as have conditions, up to the stage ``signal``."""
        n = len(conditions.time_s)
        signal = self._white.take(n)
        self.effects.apply("white", signal, conditions)
        for process in self._slow:
            signal += process.take(n)
        self.effects.apply("noise", signal, conditions)
        signal += self._truth.offset
        if self._truth.R:
            signal += self._truth.R * conditions.time_s
        for process in self._angle:
            signal += process.take(n)
        self.effects.apply("signal", signal, conditions)
        return signal


class Thermometer:
    """T(t) = start + room(t) + rise (1 - exp(-t / time constant)), read with white noise.

    Parameters
    ----------
    truth : TemperatureTruth
        Constants of the equation.
    run : Run
        What is the same for all axes.
    """

    def __init__(self, truth: TemperatureTruth, run: Run) -> None:
        self._truth = truth
        self._hold = max(1, round(run.rate_hz / REFRESH_HZ))
        self._refresh_hz = run.rate_hz / self._hold
        self._room = GaussMarkov(
            truth.wander_c, truth.wander_s, self._refresh_hz, run.stream("room")
        )
        self._noise = run.stream("thermometer")
        self._row = 0
        self._refreshed = 0
        self._room_at_start = float(self._room.take(1)[0])
        self._last = np.empty((2, 0))

    def take(self, n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return true temperature and reading in degC at the next `n` samples, each (n,)."""
        refresh = np.arange(self._row, self._row + n) // self._hold
        begin = self._refreshed - self._last.shape[1]
        known = np.hstack((self._last, self._renew(int(refresh[-1]) + 1 - self._refreshed)))
        self._last = known[:, -1:]
        self._row += n
        true, reading = known[:, refresh - begin]
        return true, reading

    def _renew(self, n: int) -> NDArray[np.float64]:
        """Return the next `n` values of the register: true temperature and reading, (2, n)."""
        truth = self._truth
        time_s = np.arange(self._refreshed, self._refreshed + n) / self._refresh_hz
        self._refreshed += n
        room = self._room.take(n) - self._room_at_start
        rise = -truth.self_heating_c * np.expm1(-time_s / truth.self_heating_s)
        true = truth.start_c + room + rise
        return np.vstack((true, true + truth.sensor_noise_c * self._noise.standard_normal(n)))
