"""`analyse` for Python: whatever holds samples, to the end, as the command of that name does.

Arrays become a stream: a StreamInfo, Blocks and Gaps, as if from a decoder. That way
everything that is done with a device is done with arrays too: the same sums, fit and closed loop.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from allanscope.allan import CurveChoices
from allanscope.analysis import Analyser, Analysis, summarise
from allanscope.parts import OSCILLATOR_TOLERANCE, PARTS, RESET_FULL_SCALES, part_named
from allanscope.pipeline.analyse_file import analyse_input, full_settings
from allanscope.pipeline.columns import (
    Columns,
    columns_of_table,
    quantity_of,
    with_guesses,
    with_units,
)
from allanscope.pipeline.settings import DeviceSettings
from allanscope.recording import Recording
from allanscope.samples import Block, Event, Gap, Notice, StreamInfo, Ticks, unit_of
from allanscope.view import is_notebook
from allanscope.wire import LinkStats
from allanscope.wire.continuity import losses_of
from allanscope.wire.text import DIVISORS, LARGEST, SMALLEST
from allanscope.wire.timestamps import (
    long_gaps,
    mean_rate,
    period_of,
    resolution_of,
    rows_come_in_bursts,
    rows_come_unevenly,
)
from allanscope.worker_process import WorkerProcess

__all__ = ["analyse", "analyse_columns", "columns_text", "events_of_columns"]

ROWS = 1 << 16
"""Rows of one Block."""

LOOKED_AT = 1 << 14
"""Rows by whose times it is told how they are paced."""

LONG_STEP = 1.5
"""Times that lie farther apart than this many periods have samples missing between them."""


def analyse(
    recording_or_arrays: str | os.PathLike[str] | Recording | Mapping[str, ArrayLike] | ArrayLike,
    rate: float | None = None,
    *,
    axes: Sequence[str] | None = None,
    units: Mapping[str, str] | str | None = None,
    part: str = "",
    gyro_fs: float | None = None,
    accel_fs: float | None = None,
    wire: str = "",
    stream: str = "",
    quiet: bool | None = None,
    curves: CurveChoices | None = None,
) -> Analysis:
    """Return the full result of a recording, a file or arrays: every curve, and the closed loop.

    Parameters
    ----------
    recording_or_arrays
        A path (a recording, the folder of a session, a raw capture, delimited text, a file of
        arrays: .npz, .npy, .mat, Parquet; a bag of ROS 2); a `Recording`;
        an array of shape (n,) or (n, axes), integers or floats; or a mapping of column names to
        arrays of shape (n,): t, gx gy gz, ax ay az, temp, each alone or with its unit as in
        ``"gx[mdps]"``. A table or a column of pandas or polars, an ``.npz`` file, and an array or
        a dataset of xarray will do as well: an index of times is the time, the name of a column
        that of the axis; those of xarray come with their coordinates and ``units``.
    rate : float, optional
        Nominal sample rate in Hz. Needed where neither the stream nor a column t gives it, and
        above times that disagree with it.
    axes : sequence of str, optional
        Name of each column of an array; without it one is gx, three the gyro, six both sensors;
        where gravity is in the first three these are the accelerometer.
    units : mapping or str, optional
        Unit by axis (``gx``), by sensor (``gyro``, ``accel``) or of all: dps mdps deg/h rad/s
        mrad/s, g mg m/s^2, lsb. Without it integers are counts, floats dps and g; an
        accelerometer that reads 9.81 or 1000 at rest is in m/s^2 or mg. `Analysis.assumptions`
        says so.
    part : str
        LSM6DS3H, LSM6DSL or LSM6DSM: whose datasheet the noise is compared with.
    gyro_fs, accel_fs : float, optional
        Full scales in dps and g, which give counts their scale. Where counts come without, those
        that the parts have after a reset are taken, 250 dps and 2 g, and ``input`` says so.
    wire : str
        Wire format of a capture; found out if not given.
    stream : str
        Which of several sensors in a file: the topic of a bag. Without it the one with the most
        samples.
    quiet : bool, optional
        False to show progress while a file is read; by default it is shown in a notebook alone.
    curves : CurveChoices, optional
        Which estimators at which averaging times, with which factors.

    Returns
    -------
    Analysis
        `Analysis.to_dict` is the JSON result, schema ``allanscope/1``.

    Raises
    ------
    ValueError
        For arrays that make no sense: the message says which column, and why.
    UsageError
        For a part, a full scale, a unit or a wire format that does not exist.
    InputError
        When a file cannot be read or contains no samples.

    Examples
    --------
    >>> import numpy as np
    >>> white = 0.05 * np.random.default_rng(1).standard_normal(20_000)  # dps: N = 0.05 / sqrt(100)
    >>> result = analyse({"gz[dps]": white}, rate=100.0)
    >>> N = result.axes["gz"].coefficients["N"]
    >>> N.unit, N.lower < 0.005 < N.upper
    ('dps/sqrt(Hz)', True)
    >>> result.axes["gz"].explanation.effects
    ()
    """
    if rate is not None and not isinstance(rate, Real):
        raise ValueError(f"rate must be a number, in Hz, got {rate!r}")
    device = DeviceSettings(
        part=part, rate_hz=rate, gyro_fs=gyro_fs, accel_fs=accel_fs, wire=wire, stream=stream
    )
    source: Any = recording_or_arrays
    if isinstance(source, Recording):
        source = source.path
    if isinstance(source, str | os.PathLike):
        if axes is not None or isinstance(units, str):
            raise ValueError("a file names its axes itself; give units as {'gyro': 'mdps'}")
        device = replace(device, units=tuple((units or {}).items()))
        silent = not is_notebook() if quiet is None else quiet
        return analyse_input(Path(source), device, silent, curves)
    columns = columns_of_table(source, axes)
    return analyse_columns(with_units(columns, units), device, {"name": "arrays"}, curves)


def analyse_columns(
    columns: Columns,
    device: DeviceSettings,
    facts: Mapping[str, str],
    curves: CurveChoices | None = None,
    workers: Sequence[WorkerProcess] = (),
) -> Analysis:
    """Return the full result.

    Parameters
    ----------
    columns : Columns
        Samples, times and temperatures.
    device : DeviceSettings
        What the user said.
    facts : mapping
        Where they came from.
    curves : CurveChoices, optional
        How the curves are made.
    workers : sequence of WorkerProcess
        They search beside this process.

    Raises
    ------
    ValueError
        For samples that make no sense.
    """
    columns = with_guesses(columns)
    settings = replace(full_settings(device.part, curves=curves), full_scales=device.full_scales)
    analyser = Analyser(settings)
    for event in events_of_columns(columns, device):
        analyser.feed(event)
    state = analyser.state
    if state is None or not state.samples:
        raise ValueError("the arrays contain no samples; nothing to analyse")
    known = {"wire": state.info.wire, **facts, "units": columns_text(columns, state.info)}
    link = LinkStats(samples=state.samples, lost_samples=state.lost)
    return summarise(analyser, link, "full", known, workers=workers)


def columns_text(columns: Columns, info: StreamInfo) -> str:
    """Return how the columns were understood: ``gx dps, gy dps`` or ``az lsb of 6.1e-05 g``."""
    words = []
    for axis, scale in zip(columns.axes, info.scale, strict=True):
        unit = columns.unit(axis)
        words.append(f"{axis} {unit}" + (f" of {scale:g} {unit_of(axis)}" if unit == "lsb" else ""))
    return ", ".join(words)


def events_of_columns(columns: Columns, device: DeviceSettings) -> Iterator[Event]:
    """Yield what a decoder would yield of these samples.

    Integers without a unit are counts, floats dps and g. Where the times leave a period out, or
    rows without times had NaN, there is a Gap.

    Raises
    ------
    ValueError
        For a sample that is not finite, times that do not go up, or a rate that neither the caller
        nor the times tell.
    """
    timing = _timing(columns.time_s, device.rate_hz)
    gaps = timing.gaps if columns.lost == {} else columns.lost
    columns = replace(columns, time_s=columns.time_s if timing.used else None)
    info, counts = _described(columns, device, timing.hz)
    yield info
    for remark in (*columns.assumed, *_scale_remarks(columns, device), *timing.remarks):
        yield Notice("text", remark, {"host": 1, "assumed": 1})
    n = len(next(iter(columns.axes.values())))
    bounds = [0, *gaps, n]
    index = 0
    for start, stop in pairwise(bounds):
        if start:
            lost = gaps[start]
            yield Gap("file", lost)
            index += lost
        for first in range(start, stop, ROWS):
            rows = slice(first, min(first + ROWS, stop))
            yield Block(index, counts(rows), _ticks(columns, rows))
            index += rows.stop - rows.start


class _Timing(NamedTuple):
    """What times are good for: whether they are used, the rate, and the gaps that they show."""

    used: bool
    hz: float
    gaps: dict[int, int]
    remarks: tuple[str, ...] = ()


def _timing(times: NDArray[np.float64] | None, given: float | None) -> _Timing:
    """Return what the times show; a rate that the user gave overrules it.

    Raises
    ------
    ValueError
        For times that do not go up, or without any rate.
    """
    if times is None or len(times) < 3:
        return _Timing(times is not None, given or _rate_of(times), {})
    rough = losses_of(times, resolution_of(cast("Any", times[:1000])))
    gaps = _gaps(times) if rough is None else rough
    mean = mean_rate(times)
    first = times[:LOOKED_AT]
    if rough is None and (rows_come_in_bursts(first) or rows_come_unevenly(first)):
        mean = _without_long_gaps(times, mean)
        words = f"the times come unevenly or in bursts, {mean:.4g} rows per second on average"
        if given:
            words += f"; they are ignored, the rate is the given {given:g} Hz"
            return _Timing(False, given, long_gaps(times, given), (words,))
        words += ", which is used as the rate; single lost samples do not show"
        return _Timing(True, float(f"{mean:.4g}"), long_gaps(times, mean), (words,))
    period = period_of(cast("Any", first))
    mostly_lost = sum(gaps.values()) > len(times)
    shown = 1.0 / period if period and not mostly_lost else mean
    if given and shown and abs(shown / given - 1.0) > OSCILLATOR_TOLERANCE:
        words = (
            f"the times show {shown:.4g} rows per second, not the given {given:g} Hz; "
            "they are ignored"
        )
        return _Timing(False, given, {}, (words,))
    return _Timing(True, given or _rate_of(times), gaps)


def _without_long_gaps(times: NDArray[np.float64], mean: float) -> float:
    """Return rows over time where rows came; how many a gap lacks depends in turn on the rate."""
    span = float(times[-1] - times[0])
    for _ in range(4):
        lost = sum(long_gaps(times, mean).values())
        if not lost:
            break
        mean = (len(times) - 1) / (span - lost / mean)
    return mean


def _scale_remarks(columns: Columns, device: DeviceSettings) -> list[str]:
    """Return which full scales had to be assumed."""
    given = {"gyro": device.gyro_fs, "accel": device.accel_fs}
    counted = {
        quantity_of(axis): None
        for axis in columns.axes
        if columns.unit(axis) == "lsb" and axis not in columns.scales
    }
    return [
        f"counts of {sensor} without a full scale: {RESET_FULL_SCALES[sensor]:g} "
        f"{'dps' if sensor == 'gyro' else 'g'} assumed"
        for sensor in counted
        if given[sensor] is None
    ]


def _described(
    columns: Columns, device: DeviceSettings, rate_hz: float
) -> tuple[StreamInfo, Callable[[slice], NDArray[Any]]]:
    """Return what the samples mean, and what gives the counts of some rows in that meaning."""
    part = part_named(device.part) if device.part else PARTS["LSM6DSM"]
    scale_of_counts = {
        "gyro": part.gyro_scale(device.gyro_fs or RESET_FULL_SCALES["gyro"]),
        "accel": part.accel_scale(device.accel_fs or RESET_FULL_SCALES["accel"]),
    }
    scales = []
    for axis in columns.axes:
        unit = columns.unit(axis)
        counted = columns.scales.get(axis, scale_of_counts[quantity_of(axis)])
        scales.append(counted if unit == "lsb" else 1.0)
    times = columns.time_s
    info = StreamInfo(
        axes=tuple(columns.axes),
        scale=tuple(scales),
        nominal_hz=rate_hz,
        rate_claimed=bool(device.rate_hz),
        part=device.part,
        wire="arrays",
        tabular=True,
        time_resolution_s=0.0 if times is None else resolution_of(cast("Any", times[:1000])),
        device_clock=times is not None,
    )
    dtype = _type_of_counts(columns)

    def counts(rows: slice) -> NDArray[Any]:
        """Return rows of all axes; never of the whole, which may be gigabytes."""
        found = []
        for axis, column in columns.axes.items():
            unit = columns.unit(axis)
            there = column[rows]
            found.append(there if unit == "lsb" else there / DIVISORS[quantity_of(axis)][unit])
        values = np.column_stack(found).astype(dtype, copy=False)
        if dtype is np.float64:
            _check_sizes(values, rows.start, info)
        return values

    return info, counts


def _check_sizes(values: NDArray[np.float64], start: int, info: StreamInfo) -> None:
    """Refuse what no sensor reads, and set to zero what is none of a sensor's noise either."""
    size = np.abs(values) * np.array(info.scale)
    far = np.argwhere(size > LARGEST)
    if len(far):
        row, column = far[0]
        axis = info.axes[column]
        raise ValueError(
            f"sample {start + row} of {axis} is {values[row, column]:g} {unit_of(axis)}: "
            "more than any sensor reads; leave such rows out, or give the unit of that column"
        )
    values[size < SMALLEST] = 0.0


def _type_of_counts(columns: Columns) -> type[np.generic]:
    """Return one type for all axes: int16 or int32 where all are integers, else float64."""
    counted = [
        column
        for axis, column in columns.axes.items()
        if columns.unit(axis) == "lsb" and column.dtype.kind in "iu" and column.size
    ]
    if len(counted) == len(columns.axes):
        low, high = min(int(c.min()) for c in counted), max(int(c.max()) for c in counted)
        for dtype in (np.int16, np.int32):
            if low >= np.iinfo(dtype).min and high <= np.iinfo(dtype).max:
                return dtype
    return np.float64


def _ticks(columns: Columns, rows: slice) -> Ticks:
    if columns.time_s is None and columns.temperature_c is None:
        return Ticks.none()
    n = rows.stop - rows.start
    unknown = np.full(n, np.nan)
    return Ticks(
        np.arange(n),
        unknown if columns.time_s is None else columns.time_s[rows],
        unknown,
        unknown if columns.temperature_c is None else columns.temperature_c[rows],
    )


def _gaps(times: NDArray[np.float64] | None) -> dict[int, int]:
    """Return the row after each gap, and how many samples it lacks."""
    if times is None or len(times) < 3:
        return {}
    steps = np.diff(times)
    period = float(np.median(steps))
    if not period > 0.0 or steps.min() < 0.0:
        raise ValueError("times must go up from row to row")
    after = np.flatnonzero(steps > LONG_STEP * period)
    lost = np.rint(steps[after] / period).astype(np.int64) - 1
    return dict(zip((after + 1).tolist(), lost.tolist(), strict=True))


def _rate_of(times: NDArray[np.float64] | None) -> float:
    period = None if times is None else period_of(cast("Any", times[:1000]))
    if period is None:
        raise ValueError("the sample rate is not known; give rate, in Hz, or a column t")
    return float(f"{1.0 / period:.4g}")
