"""The signal of one axis before its converter: the sensor's own noise, then the effects on it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effect_spec import EffectSpec
from allanscope.simulator.effects import Scene, Setting, effect_kinds
from allanscope.simulator.effects.base import Apply, Run, Stage
from allanscope.simulator.noise import Flicker, Process, RandomWalk, White, WhitePhase
from allanscope.simulator.truth import AxisTruth

__all__ = ["AxisSignal", "EffectChain"]


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
        See `Setting`.
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
            setting = Setting(
                rate_hz=run.rate_hz,
                duration_s=run.duration_s,
                onset_s=spec.time,
                white_sigma=white_sigma,
                lsb=lsb,
                source=spec.source,
                rng=run.stream(name, spec.kind, str(number)),
            )
            apply = kind.set_up(spec.parameters, setting)
            self._stages.setdefault(kind.stage, []).append((spec.time, apply))

    def apply(self, stage: Stage, values: NDArray[np.generic], scene: Scene) -> None:
        """Let all effects of a stage act, each from its onset on."""
        for onset_s, effect in self._stages.get(stage, ()):
            rows = int(np.searchsorted(scene.time_s, onset_s))
            if rows == 0:
                effect(values, scene)
            elif rows < len(values):
                effect(values[rows:], scene.after(rows))

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
        self._slow: list[Process] = []
        if truth.B:
            self._slow.append(Flicker(truth.B, rate, run.stream(axis, "flicker")))
        if truth.K:
            self._slow.append(RandomWalk(truth.K, rate, run.stream(axis, "random walk")))
        self._angle = WhitePhase(truth.Q, rate, run.stream(axis, "angle")) if truth.Q else None
        self.effects = EffectChain(effects, axis, run, self._white.sigma, lsb)

    def take(self, scene: Scene) -> NDArray[np.float64]:
        """Return the next samples, as many as the scene has, up to the stage ``signal``."""
        n = len(scene.time_s)
        signal = self._white.take(n)
        self.effects.apply("white", signal, scene)
        for process in self._slow:
            signal += process.take(n)
        self.effects.apply("noise", signal, scene)
        signal += self._truth.offset
        if self._truth.R:
            signal += self._truth.R * scene.time_s
        if self._angle is not None:
            signal += self._angle.take(n)
        self.effects.apply("signal", signal, scene)
        return signal
