"""The simulated sensor as a stream of Blocks: exact, endless, the same for every way of reading."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from allanscope.errors import UsageError
from allanscope.parts import part_named
from allanscope.samples import AXES, INT16_MAX, INT16_MIN, Block, StreamInfo, Ticks
from allanscope.simulator.effects import Conditions, Run, effect_kinds
from allanscope.simulator.noise import stream
from allanscope.simulator.signals import AxisSignal, EffectChain, Thermometer
from allanscope.simulator.truth import AxisTruth, Truth

__all__ = ["DeviceClock", "Simulator"]

CHUNK = 4096
"""Rows made at a time; reading in other portions only cuts them."""
REFERENCE_C = 25.0
UNKNOWN_DURATION_S = 3600.0
LARGEST_ERROR = 0.045
"""ST's own logs show -4.4 % and +1.9 % for parts of this family."""
CRYSTAL_PPM = 20.0
LATENCY_S = 10e-6
"""A time stamp is taken up to this long after the sample was ready."""


@dataclass(frozen=True, slots=True)
class DeviceClock:
    """The two clocks of a device, both slightly wrong: the sensor's oscillator, the MCU's crystal.

    It tells how true time, samples and time stamps hang together.

    Attributes
    ----------
    nominal_hz : float
        Sample rate that the device claims.
    relative_error : float
        True sample rate / nominal rate - 1.
    crystal_ppm : float
        Error of the crystal that makes the time stamps.
    """

    nominal_hz: float
    relative_error: float
    crystal_ppm: float

    @classmethod
    def of_specimen(cls, nominal_hz: float, seed: int, relative_error: float | None) -> DeviceClock:
        """Return the clocks of one specimen; without an error it has one of up to +-4.5 %."""
        rng = stream(seed, "clock")
        drawn, ppm = rng.uniform(-LARGEST_ERROR, LARGEST_ERROR), rng.normal(0.0, CRYSTAL_PPM)
        return cls(nominal_hz, drawn if relative_error is None else relative_error, ppm)

    @property
    def true_hz(self) -> float:
        """True sample rate."""
        return self.nominal_hz * (1.0 + self.relative_error)

    def stamps(self, time_s: NDArray[np.float64], rng: Generator) -> NDArray[np.float64]:
        """Return what the MCU's clock shows for samples ready at true times `time_s`."""
        late = rng.uniform(0.0, LATENCY_S, len(time_s))
        return np.asarray((time_s + late) * (1.0 + 1e-6 * self.crystal_ppm))


@dataclass(frozen=True, slots=True)
class _Rows:
    counts: NDArray[np.int16]
    device_s: NDArray[np.float64]
    temperature_c: NDArray[np.float64]


class Simulator:
    """An inertial sensor with known truth.

    Parameters
    ----------
    part : str
        LSM6DS3H, LSM6DSL or LSM6DSM.
    rate : float
        Nominal sample rate in Hz.
    seed : int
        Makes the specimen and its noise: the same seed gives the same samples.
    truth : Truth, optional
        Noise and effects; `Truth.typical` of the part when not given.
    gyro_fs, accel_fs : float
        Full scales in dps and g.
    clock_error : float, optional
        True / nominal rate - 1. Without it that of the truth's ``clock_error`` effect, and without
        one of those the specimen's own, up to +-4.5 %.
    axes : tuple of str
        Which axes to make. Leaving some out does not change the others.
    duration_s : float
        Length of the record, for effects that happen a number of times in it (outliers,
        variance_change).
    run : int
        Another run of the same specimen: its clock and its levels, other noise.

    Raises
    ------
    UsageError
        For a part, a full scale, a rate or an axis that does not exist.

    Examples
    --------
    >>> sensor = Simulator(rate=104.0, seed=1)
    >>> block = sensor.read(5)
    >>> block.index, block.counts.shape, block.counts.dtype
    (0, (5, 6), dtype('int16'))
    >>> sensor.read(3).index
    5
    """

    def __init__(
        self,
        part: str = "LSM6DSM",
        rate: float = 104.0,
        seed: int = 0,
        *,
        truth: Truth | None = None,
        gyro_fs: float = 125.0,
        accel_fs: float = 2.0,
        clock_error: float | None = None,
        axes: tuple[str, ...] = AXES,
        duration_s: float = UNKNOWN_DURATION_S,
        run: int = 0,
    ) -> None:
        self._arguments: dict[str, Any] = {
            "part": part,
            "rate": rate,
            "seed": seed,
            "truth": truth,
            "gyro_fs": gyro_fs,
            "accel_fs": accel_fs,
            "clock_error": clock_error,
            "axes": axes,
            "duration_s": duration_s,
            "run": run,
        }
        known = part_named(part)
        if not 0.0 < rate <= 1e6:
            raise UsageError(f"a sample rate of {rate:g} Hz is not possible")
        if seed < 0:
            raise UsageError(f"a seed is 0 or more, not {seed}")
        if not axes or not set(axes) <= set(AXES):
            raise UsageError(f"axes {axes!r} do not exist; choose from {' '.join(AXES)}")
        self.truth = Truth.typical(known.name, seed) if truth is None else truth
        error = self.truth.clock_error if clock_error is None else clock_error
        self.clock = DeviceClock.of_specimen(rate, seed, error)
        axes = tuple(axis for axis in AXES if axis in axes)
        scale = {"g": known.gyro_scale(gyro_fs), "a": known.accel_scale(accel_fs)}
        self.info = StreamInfo(
            axes=axes,
            scale=tuple(scale[axis[0]] for axis in axes),
            nominal_hz=rate,
            part=known.name,
            time_resolution_s=1e-6,
            device_clock=True,
            details={"firmware": "allanscope simulator", "board": "simulated SensorTile"},
            origin="synthetic",
        )
        self.index = 0
        self._chunk = _Rows(np.empty((0, len(axes)), np.int16), np.empty(0), np.empty(0))
        self._used = 0
        self._made = 0
        self._late_s = 0.0
        self._set_up(Run(seed, self.clock.true_hz, duration_s, run))

    def _set_up(self, run: Run) -> None:
        lsb = dict(zip(self.info.axes, self.info.scale, strict=True))
        sources = {e.source for e in self.truth.effects if e.source and set(e.axes) & set(lsb)}
        # An axis that is only the source of a coupling exists without being put out.
        self._signals = {
            axis: AxisSignal(
                axis,
                self.truth.axes.get(axis, AxisTruth()),
                self.truth.effects_on(axis),
                run,
                lsb.get(axis, 1.0),
            )
            for axis in AXES
            if axis in lsb or axis in sources
        }
        self._coupled = any(signal.effects.has("coupling") for signal in self._signals.values())
        self._row_effects = [
            (
                [i for i, axis in enumerate(self.info.axes) if axis in spec.axes],
                EffectChain([spec], f"rows {number}", run),
            )
            for number, spec in enumerate(self.truth.effects)
            if effect_kinds()[spec.kind].stage == "rows"
        ]
        self._thermometer = Thermometer(self.truth.temperature, run)
        self._stamp_noise = run.stream("stamps")

    def reconfigured(self, **changes: Any) -> Simulator:
        """Return another run of the same specimen with other arguments, e.g. ``rate=208.0``.

        Examples
        --------
        >>> sensor = Simulator(rate=104.0, seed=1)
        >>> sensor.reconfigured(rate=208.0).info.nominal_hz
        208.0
        """
        next_run = {"run": self._arguments["run"] + 1}
        return Simulator(**{**self._arguments, **next_run, **changes})

    @property
    def time_s(self) -> float:
        """True time at which the next row is ready, in s since the first."""
        return self.index / self.clock.true_hz

    def read(self, n: int) -> Block:
        """Return the next `n` rows, with time and temperature at each of them.

        The device time is that of the MCU's crystal since the first row.
        """
        parts = [self._next_rows(n)]
        while (missing := n - sum(len(part.counts) for part in parts)) > 0:
            parts.append(self._next_rows(missing))
        counts = np.concatenate([part.counts for part in parts])
        ticks = Ticks(
            offset=np.arange(n),
            device_s=np.concatenate([part.device_s for part in parts]),
            host_s=np.full(n, np.nan),
            temperature_c=np.concatenate([part.temperature_c for part in parts]),
        )
        block = Block(self.index, counts, ticks)
        self.index += n
        return block

    def _next_rows(self, most: int) -> _Rows:
        """Return up to `most` rows of the current chunk; make the next one when it is used up."""
        if self._used == len(self._chunk.counts):
            self._chunk, self._used = self._next_chunk(), 0
        rows = slice(self._used, self._used + most)
        chunk = self._chunk
        part = _Rows(chunk.counts[rows], chunk.device_s[rows], chunk.temperature_c[rows])
        self._used += len(part.counts)
        return part

    def _times(self, true_c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the true times of the next rows in s; the rate may follow time and temperature."""
        time_s = np.arange(self._made, self._made + len(true_c)) / self.clock.true_hz
        drift, per_degc = self.truth.clock_wander
        if not drift and not per_degc:
            return time_s
        # To the first order in parts per million: a period is as much longer as the rate is lower.
        slower = -(drift / 3600.0 * time_s + per_degc * (true_c - REFERENCE_C)) * 1e-6
        late = self._late_s + np.cumsum(slower) / self.clock.true_hz
        self._late_s = float(late[-1])
        return np.asarray(time_s + late)

    def _next_chunk(self) -> _Rows:
        true_c, reading_c = self._thermometer.take(CHUNK)
        time_s = self._times(true_c)
        conditions = Conditions(self._made, time_s, true_c - REFERENCE_C, {})
        signals = {axis: signal.take(conditions) for axis, signal in self._signals.items()}
        if self._coupled:
            before = {axis: signal.copy() for axis, signal in signals.items()}
            with_axes = replace(conditions, axes=before)
            for axis, signal in self._signals.items():
                signal.effects.apply("coupling", signals[axis], with_axes)
        counts = np.empty((CHUNK, len(self.info.axes)), np.int16)
        for column, (axis, lsb) in enumerate(zip(self.info.axes, self.info.scale, strict=True)):
            values = signals[axis]
            self._signals[axis].effects.apply("rounding", values, conditions)
            counts[:, column] = _convert(values, lsb)
        for columns, effects in self._row_effects:
            rows = counts[:, columns]
            effects.apply("rows", rows, conditions)
            counts[:, columns] = rows
        self._made += CHUNK
        return _Rows(counts, self.clock.stamps(time_s, self._stamp_noise), reading_c)


def _convert(values: NDArray[np.float64], lsb: float) -> NDArray[np.float64]:
    """Return the counts that the sensor's converter gives, saturated as int16."""
    values /= lsb
    np.rint(values, out=values)
    return np.clip(values, INT16_MIN, INT16_MAX, out=values)
