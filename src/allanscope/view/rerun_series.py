"""Everything that is plotted against the time of the run: samples, coefficients, rate, link."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from allanscope.analysis import Analysis
from allanscope.noise import Coefficient
from allanscope.quantities import COEFFICIENTS, LEVEL, MAIN_LETTERS, TWO_SIDED_95, symbols
from allanscope.samples import unit_of
from allanscope.view.decimator import Rows
from allanscope.view.palette import AXIS, EFFECT, LINK, REFERENCE, muted

__all__ = ["SENSORS", "Series"]

SENSORS = {"dps": "gyro", "g": "accel"}

_TEMPERATURE_EVERY_S = 5.0

_TIME_AXES = (
    *("/samples/gyro", "/samples/accel", "/rate", "/link/throughput", "/link/lost", "/link/errors"),
    *(f"/coefficients/{sensor}/{one}" for sensor in SENSORS.values() for one in MAIN_LETTERS),
)
"""Plots on whose zero line events are marked; on that of the temperature at its last value."""
_LARGEST_ERROR = 0.3
"""Coefficients are plotted once their relative error is below this; until then their limit is."""

_FIRST_LIMIT_S, _LIMIT_SPACING = 60.0, 1.25
"""The limits of the first minute are so high that they would hide all others. Later ones are
plotted each time that the run has grown by the factor: as marks, which are told from a line."""


class Series:
    """Logs numbers against ``elapsed``, the time since the first sample.

    Parameters
    ----------
    recording : rerun.RecordingStream
        Where.
    started_unix_s : float or None
        Wall-clock time of the first sample; adds the timeline ``clock``.
    """

    def __init__(self, recording: rr.RecordingStream, started_unix_s: float | None) -> None:
        self._recording = recording
        self._started = started_unix_s
        self._level: dict[str, NDArray[np.float64]] = {}
        self._last_bytes = (0.0, 0)
        self._last_temperature_s, self._temperature_c = -math.inf, math.nan
        self._limits_due_s = _FIRST_LIMIT_S
        self._marked: set[tuple[str, int]] = set()

    def now(self, elapsed_s: float) -> None:
        """Set the time of what is logged next."""
        self._recording.set_time("elapsed", duration=elapsed_s)
        if self._started is not None:
            self._recording.set_time("clock", timestamp=self._started + elapsed_s)

    def style(self, axes: Sequence[str]) -> None:
        """Say which colour and name every series has."""
        for unit, sensor in SENSORS.items():
            names = [axis for axis in axes if unit_of(axis) == unit]
            if not names:
                continue
            colours = [AXIS[axis] for axis in names]
            faint = [muted(colour) for colour in colours]
            self._static(
                f"/samples/{sensor}",
                rr.SeriesLines(
                    names=[
                        f"{name}{part}" for part in ("", " least", " largest") for name in names
                    ],
                    colors=[*colours, *faint, *faint],
                    widths=[1.6] * len(names) + [0.8] * 2 * len(names),
                    aggregation_policy="MinMax",
                ),
            )
            for letter in MAIN_LETTERS:
                self._static(
                    f"/coefficients/{sensor}/{letter}/limit",
                    rr.SeriesPoints(
                        names=[f"{name} {letter}, upper limit" for name in names],
                        colors=colours,
                        markers=["down"] * len(names),
                        marker_sizes=[3.5] * len(names),
                    ),
                )
        self._static("/samples/temperature", rr.SeriesLines(names="°C", colors=REFERENCE))
        self._static(
            "/link/errors",
            _steps("bad checksums", "resyncs", "reconnects"),
        )
        for path in (*_TIME_AXES, "/samples/temperature"):
            self._static(
                f"{path}/events",
                rr.SeriesPoints(names="events", colors=EFFECT, markers="diamond", marker_sizes=6.0),
            )
        self._static("/link/lost", _steps("lost samples", "gaps of unknown length"))
        self._static("/link/throughput", _steps("kB/s"))
        self._static(
            "/link/state",
            rr.StateConfiguration(values=list(LINK), colors=list(LINK.values())),
        )

    def samples(self, axes: Sequence[str], rows: Rows) -> None:
        """Log rows of the decimated series: the mean, the smallest and the largest of each.

        They are counted from the first mean, else gravity would hide everything else.
        """
        index = [rr.TimeColumn("elapsed", duration=rows.elapsed_s)]
        if self._started is not None:
            index.append(rr.TimeColumn("clock", timestamp=self._started + rows.elapsed_s))
        for unit, sensor in SENSORS.items():
            chosen = [i for i, axis in enumerate(axes) if unit_of(axis) == unit]
            if chosen:
                level = self._level.setdefault(sensor, rows.mean[0, chosen])
                parts = (rows.mean, rows.low, rows.high)
                values = np.hstack([part[:, chosen] - level for part in parts])
                self._recording.send_columns(
                    f"/samples/{sensor}",
                    indexes=index,
                    columns=rr.Scalars.columns(scalars=values * LEVEL[unit].factor),
                )
        last_s = float(rows.elapsed_s[-1])
        if (
            math.isfinite(rows.temperature_c)
            and last_s - self._last_temperature_s >= _TEMPERATURE_EVERY_S
        ):
            self._last_temperature_s = last_s
            self.now(last_s)
            self._temperature_c = rows.temperature_c
            self._scalars("/samples/temperature", [rows.temperature_c])

    def result(self, analysis: Analysis) -> None:
        """Log the coefficients so far, the measured rate, and the counters of the link."""
        limits_too = analysis.duration_s >= self._limits_due_s
        if limits_too:
            self._limits_due_s = _LIMIT_SPACING * analysis.duration_s
        for unit, sensor in SENSORS.items():
            axes = [name for name, axis in analysis.axes.items() if axis.unit == unit]
            for letter in MAIN_LETTERS:
                if axes:
                    path = f"/coefficients/{sensor}/{letter}"
                    self._coefficient(path, unit, letter, analysis, limits_too)
        self._rate(analysis)
        self._events(analysis)
        link = analysis.link
        self._scalars("/link/errors", [link.crc_errors, link.resyncs, analysis.reconnects])
        self._scalars("/link/lost", [analysis.lost_samples, analysis.unknown_losses])
        last_s, last_bytes = self._last_bytes
        if analysis.duration_s > last_s:
            rate = (link.bytes - last_bytes) / (analysis.duration_s - last_s)
            self._scalars("/link/throughput", [1e-3 * rate])
            self._last_bytes = (analysis.duration_s, link.bytes)

    def _events(self, analysis: Analysis) -> None:
        """Mark what began, each time once, on every axis of time, at its onset."""
        for event in analysis.events:
            for once in event.occurrences:
                if (event.kind, once.sample) in self._marked:
                    continue
                self._marked.add((event.kind, once.sample))
                self.now(once.onset_s)
                for path in _TIME_AXES:
                    self._scalars(f"{path}/events", [0.0])
                if math.isfinite(self._temperature_c):
                    self._scalars("/samples/temperature/events", [self._temperature_c])
        self.now(analysis.duration_s)

    def health(self, numbers: Mapping[str, object]) -> None:
        """Log any counters by name; what is not a number is left out."""
        for name, value in numbers.items():
            if isinstance(value, (int, float)) and math.isfinite(value):
                self._scalars(f"/link/health/{_path(name)}", [float(value)])

    def state(self, state: str) -> None:
        """Log what the link does from now on: ``streaming``, ``gap`` or ``restarted``."""
        self._recording.log("/link/state", rr.StateChange(state=state))

    def _coefficient(
        self, path: str, unit: str, letter: str, analysis: Analysis, limits_too: bool
    ) -> None:
        reading = COEFFICIENTS[unit, letter][0]
        axes = [name for name, axis in analysis.axes.items() if axis.unit == unit]
        values, variances, limits = [], [], []
        for name in axes:
            known = analysis.axes[name].coefficients.get(letter)
            value, sigma = (math.nan, math.nan) if known is None else _value_if_precise(known)
            values.append(value * reading.factor)
            variances.append((sigma * reading.factor) ** 2)
            is_limit = known is not None and math.isnan(value)
            limits.append(known.upper * reading.factor if known and is_limit else math.nan)
        self._recording.log(
            path,
            rr.Measurements(
                values,
                variances=variances,
                units=symbols(reading.unit),
                colors=[AXIS[name] for name in axes],
                names=[f"{name} {letter}" for name in axes],
            ),
        )

        if limits_too and any(map(math.isfinite, limits)):
            self._scalars(f"{path}/limit", limits)

    def _rate(self, analysis: Analysis) -> None:
        rate = analysis.rate
        if rate.measured_hz is None or not rate.nominal_hz:
            return
        self._recording.log(
            "/rate",
            rr.Measurements(
                [1e6 * (rate.measured_hz / rate.nominal_hz - 1.0)],
                variances=[(rate.uncertainty_ppm or 0.0) ** 2],
                units="ppm",
                names="rate over nominal",
                colors=[REFERENCE],
            ),
        )

    def _scalars(self, path: str, values: Sequence[float]) -> None:
        self._recording.log(path, rr.Scalars(values))

    def _static(self, path: str, style: rr.AsComponents) -> None:
        self._recording.log(path, style, static=True)


def _value_if_precise(coefficient: Coefficient) -> tuple[float, float]:
    """Return value and standard error; NaN while the error is so large that it hides the rest."""
    sigma = (coefficient.upper - coefficient.lower) / (2.0 * TWO_SIDED_95)
    if not coefficient.detected or sigma > _LARGEST_ERROR * coefficient.value:
        return math.nan, math.nan
    return coefficient.value, sigma


def _steps(*names: str) -> rr.SeriesLines:
    """Return the style of counters: they jump, they do not slope."""
    return rr.SeriesLines(names=list(names), interpolation_mode="StepAfter")


def _path(name: str) -> str:
    """Return a name that needs no escaping in an entity path."""
    return "".join(c if c.isascii() and c.isalnum() else "_" for c in name.lower()) or "_"
