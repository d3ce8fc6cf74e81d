"""The classical theory by itself: conversions, single quantities, and charts of the method.

`convert_table` turns densities and deviations of tables into each other, `stability_table` computes
what stability programs have beside the curves of an analysis, and `draw_chart` draws.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import (
    KINDS,
    avlr,
    chi_square_limits,
    degrees_of_freedom,
    density_of_deviation,
    deviation,
    deviation_of_density,
    factors_at,
    factors_of,
    gcodev,
    mtie,
    phase_to_rate_density,
    rate_to_phase_density,
    three_cornered_hat,
    tierms,
)
from allanscope.atomic_write import write_text
from allanscope.clock import Clock
from allanscope.errors import InputError, UsageError
from allanscope.noise import deviation_covariance, fit_power_laws, model_of
from allanscope.parts import part_named
from allanscope.pipeline.analyse_file import FULL_ROWS, settings_of
from allanscope.pipeline.decoding import Decoding
from allanscope.pipeline.replaying import events_of
from allanscope.pipeline.settings import DeviceSettings
from allanscope.pipeline.table_files import is_table_file, table_of_file
from allanscope.quantities import count, duration
from allanscope.recording import is_recording
from allanscope.samples import Block, Gap, StreamInfo, unit_of
from allanscope.sanitize import print_error

if TYPE_CHECKING:
    from allanscope.report import ChainStep

__all__ = [
    "DENSITIES",
    "StabilityRequest",
    "chain_steps",
    "convert_table",
    "draw_chart",
    "stability_table",
]

DENSITIES = ("S_y", "S_phi", "L")
"""One-sided density of the rate, of the phase in rad^2/Hz, and half of that in dB."""

Floats = NDArray[np.float64]

_POINTS = 400
"""Of a density between two deviations."""


def convert_table(
    source: Path, out: Path, given: str, wanted: str, rate: float | None, carrier: float
) -> None:
    """Turn a table of two columns into one of another quantity.

    Parameters
    ----------
    source, out : Path
        Delimited text: frequency in Hz, or averaging time in s, and the quantity. Lines that begin
        with a letter or ``#`` are left out.
    given, wanted : str
        Of `DENSITIES`, or a deviation by name.
    rate : float or None
        Samples per second: where a density ends. By default twice the highest frequency, or one
        sample in the shortest averaging time.
    carrier : float
        In Hz, for S_phi and L; 0 for an angle, whose rate is in rad/s.

    Raises
    ------
    InputError, UsageError
        For a table that cannot be read, or numbers that make no sense.
    """
    for one in (given, wanted):
        if one not in DENSITIES and one.lower() not in KINDS:
            raise UsageError(
                f"unknown quantity {one!r}; choose {', '.join(DENSITIES)} or a deviation: "
                f"{' '.join(KINDS)}"
            )
    given, wanted = (one if one in DENSITIES else one.lower() for one in (given, wanted))
    x, y = _table(source)
    try:
        if wanted in DENSITIES:
            rows = _density(given, wanted, x, y, rate, carrier)
        else:
            rows = _deviation(given, wanted, x, y, rate, carrier)
    except ValueError as error:
        raise UsageError(str(error)) from None
    head = "f_hz" if wanted in DENSITIES else "tau_s"
    lines = [f"{a:.9g},{b:.9g}" for a, b in zip(*rows, strict=True)]
    write_text(out, "\n".join([f"{head},{wanted}", *lines]) + "\n")


def _density(
    given: str, wanted: str, x: Floats, y: Floats, rate: float | None, carrier: float
) -> tuple[Floats, Floats]:
    if given in DENSITIES:
        return x, _as(wanted, x, _as_rate(given, x, y, carrier), carrier)
    f = 1.0 / (np.pi * x[::-1])
    return f, _as(wanted, f, density_of_deviation(x, y, f, given, rate), carrier)


def _deviation(
    given: str, wanted: str, x: Floats, y: Floats, rate: float | None, carrier: float
) -> tuple[Floats, Floats]:
    if given in DENSITIES:
        hz = rate or 2.0 * float(x.max())
        f, density = x, _as_rate(given, x, y, carrier)
        last = max(int(np.log2(hz / float(f.min()))), 1)
        tau = 2.0 ** np.arange(last) / hz
    else:
        hz, tau = rate or 1.0 / float(x.min()), x
        f = np.geomspace(0.01 / float(x.max()), hz / 2.0, _POINTS)
        density = density_of_deviation(x, y, f, given, hz)
    m = np.unique(factors_at(tau, hz, wanted))
    times = (0.75 if wanted == "theo1" else 1.0) * m / hz
    return times, deviation_of_density(f, density, m, hz, wanted)


def _table(path: Path) -> tuple[Floats, Floats]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        found = [line.replace(",", " ").replace(";", " ").split() for line in lines]
        rows = [[float(a), float(b)] for a, b, *_ in (r for r in found if _is_numeric(r))]
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path}: no table of two columns: {error}") from None
    if len(rows) < 2:
        raise InputError(f"{path}: a table needs two rows of numbers or more")
    x, y = np.array(rows).T
    if x.min() <= 0.0:
        raise InputError(
            f"{path}: {x.min():g} in the first column: frequencies in Hz, or averaging times in s, "
            "are above 0"
        )
    order = np.argsort(x)
    return x[order], y[order]


def _is_numeric(cells: list[str]) -> bool:
    return len(cells) > 1 and (cells[0][:1].isdecimal() or cells[0][:1] in ".+-")


def _as_rate(given: str, f: Floats, y: Floats, carrier: float) -> Floats:
    """Return S_y of any density."""
    if given == "S_y":
        return y
    phase = 2.0 * 10.0 ** (y / 10.0) if given == "L" else y
    return phase_to_rate_density(f, phase, carrier)


def _as(wanted: str, f: Floats, density: Floats, carrier: float) -> Floats:
    """Return any density of S_y."""
    if wanted == "S_y":
        return density
    phase = rate_to_phase_density(f, density, carrier)
    return np.asarray(10.0 * np.log10(phase / 2.0)) if wanted == "L" else phase


@dataclass(frozen=True, slots=True)
class StabilityRequest:
    """One quantity of the theory, and what it is asked of.

    Attributes
    ----------
    name : str
        fit, identify, avlr, mtie, tierms, gcodev, hat, edf or cov.
    inputs : tuple of Path
        Files of samples: one; two for gcodev (A - B and A - C); three for hat (A - B, B - C,
        C - A); none for edf and cov.
    axis : str
        Axis of a file that has several; its first if empty.
    is_phase : bool
        Whether text of one column is phase and not rate.
    taus : str or tuple of float
        As in `deviation`.
    kind : str
        Estimator, for hat, edf and cov.
    letters : str
        Power laws of fit, ``auto`` for those that are identified; the line of avlr.
    low_s, high_s : float
        Range of tau of avlr.
    noise_type : str
        Of edf.
    model : str
        Of cov: ``N=0.003,B=0.001``.
    samples : int
        Length of the run, for edf and cov.
    device : DeviceSettings
        What a file does not say by itself.
    quiet : bool
        Show no progress.
    """

    name: str
    inputs: tuple[Path, ...] = ()
    axis: str = ""
    is_phase: bool = False
    taus: str | tuple[float, ...] = "octave"
    kind: str = "oadev"
    letters: str = "auto"
    low_s: float = 0.0
    high_s: float = 1e12
    noise_type: str = "WFM"
    model: str = ""
    samples: int = 0
    device: DeviceSettings = field(default_factory=DeviceSettings)
    quiet: bool = True


@dataclass(frozen=True, slots=True)
class _Series:
    """The longest stretch of an axis without a gap: rates in dps, g, or whatever the text has."""

    rates: Floats
    rate_hz: float
    unit: str

    @property
    def phase(self) -> Floats:
        """Return the integral of the rates, in their unit times s."""
        return np.append(0.0, np.cumsum(self.rates)) / self.rate_hz


def stability_table(request: StabilityRequest) -> str:
    """Return a quantity of the theory as delimited text, a row for each averaging time or letter.

    Raises
    ------
    UsageError
        For a wrong number of inputs, or what the quantity cannot be computed of.
    InputError
        When a file cannot be read.
    """
    make, inputs = _QUANTITIES[request.name]
    if len(request.inputs) != inputs:
        needed = f"{inputs or 'no'} input{'s' * (inputs != 1)}"
        raise UsageError(f"{request.name} takes {needed}, {len(request.inputs)} given")
    series = [_series_of(path, request) for path in request.inputs]
    try:
        columns = make(request, *series)
    except ValueError as error:
        raise UsageError(str(error)) from None
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(_cell(value) for value in row) for row in rows]
    return "\n".join([",".join(columns), *lines]) + "\n"


def _cell(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(value)


Columns = Mapping[str, list[Any]]


def _fit(request: StabilityRequest, one: _Series) -> Columns:
    found = fit_power_laws(one.rates, one.rate_hz, request.letters, unit=one.unit)
    names = ("value", "lower", "upper", "unit")
    columns = {name: [getattr(c, name) for c in found.values()] for name in names}
    detected = [int(c.detected) for c in found.values()]
    return {"coefficient": list(found), **columns, "detected": detected}


def _identify(request: StabilityRequest, one: _Series) -> Columns:
    curve = deviation(one.rates, one.rate_hz, request.kind, _taus(request, one.rate_hz))
    names = ("tau", "m", "noise", "edf", "deviation", "lower", "upper")
    return {"tau_s" if k == "tau" else k: getattr(curve, k).tolist() for k in names}


def _avlr(request: StabilityRequest, one: _Series) -> Columns:
    letter = "N" if request.letters == "auto" else request.letters
    curve = deviation(one.rates, one.rate_hz, "oadev", _taus(request, one.rate_hz))
    found = avlr(curve, letter, request.low_s, request.high_s)
    names = ("value", "lower", "upper", "chi2", "points")
    return {"coefficient": [letter], **{name: [getattr(found, name)] for name in names}}


def _factors(request: StabilityRequest, kind: str, n: int, rate: float) -> list[int]:
    found: list[int] = factors_of(kind, _taus(request, rate), n, rate).tolist()
    return found


def _taus(request: StabilityRequest, rate: float) -> Any:
    """Return a set of averaging times by name, or times of the nearest whole number of samples."""
    if isinstance(request.taus, str):
        return request.taus
    return [max(round(tau * rate), 1) / rate for tau in request.taus]


def _time_error(quantity: Callable[..., Floats]) -> Callable[..., Columns]:
    def columns(request: StabilityRequest, one: _Series) -> Columns:
        m = _factors(request, "oadev", one.rates.size, one.rate_hz)
        values = quantity(one.phase, m).tolist()
        return {"tau_s": [k / one.rate_hz for k in m], "m": m, request.name: values}

    return columns


def _gcodev(request: StabilityRequest, first: _Series, second: _Series) -> Columns:
    rate = _one_rate(first, second)
    m = _factors(request, "oadev", first.rates.size, rate)
    values = gcodev(first.rates, second.rates, rate, m).tolist()
    return {"tau_s": [k / rate for k in m], "m": m, "gcodev": values}


def _hat(request: StabilityRequest, *pairs: _Series) -> Columns:
    rate = _one_rate(*pairs)
    curves = [deviation(pair.rates, rate, request.kind, _taus(request, rate)) for pair in pairs]
    found = three_cornered_hat(*(curve.variance for curve in curves))
    tau, m = curves[0].tau.tolist(), curves[0].m.tolist()
    deviations = [(np.sign(v) * np.sqrt(np.abs(v))).tolist() for v in found]
    return {"tau_s": tau, "m": m, **dict(zip("abc", deviations, strict=True))}


def _edf(request: StabilityRequest) -> Columns:
    rate, n = _run(request)
    m = _factors(request, request.kind, n, rate)
    edf = degrees_of_freedom(request.kind, request.noise_type, m, n)
    lower, upper = chi_square_limits(1.0, edf)
    limits = {"lower": lower.tolist(), "upper": upper.tolist()}
    return {"tau_s": [k / rate for k in m], "m": m, "edf": edf.tolist(), **limits}


def _cov(request: StabilityRequest) -> Columns:
    rate, n = _run(request)
    m = np.array(_factors(request, request.kind, n, rate))
    model = model_of(request.model, 1.0 / rate)
    covariance = deviation_covariance(model, request.kind, m, n)
    expected = model.deviation(request.kind, m) ** 2
    columns = {f"m{k}": covariance[:, i].tolist() for i, k in enumerate(m.tolist())}
    head = {"tau_s": (m / rate).tolist(), "m": m.tolist(), "variance": expected.tolist()}
    return {**head, **columns}


_QUANTITIES: Mapping[str, tuple[Callable[..., Columns], int]] = {
    "fit": (_fit, 1),
    "identify": (_identify, 1),
    "avlr": (_avlr, 1),
    "mtie": (_time_error(mtie), 1),
    "tierms": (_time_error(tierms), 1),
    "gcodev": (_gcodev, 2),
    "hat": (_hat, 3),
    "edf": (_edf, 0),
    "cov": (_cov, 0),
}
"""Each quantity, and the files that it takes."""


def _run(request: StabilityRequest) -> tuple[float, int]:
    if request.samples < 1:
        raise UsageError(f"{request.name} needs --samples, the length of the run")
    return request.device.rate_hz or 1.0, request.samples


def _one_rate(*series: _Series) -> float:
    rates = {one.rate_hz for one in series}
    if len(rates) > 1:
        raise ValueError(f"the records have different rates: {sorted(rates)} Hz")
    return rates.pop()


def _series_of(path: Path, request: StabilityRequest) -> _Series:
    column = _single_column(path)
    if column is not None:
        rate = request.device.rate_hz or 1.0
        rates = np.diff(column) * rate if request.is_phase else column
        return _Series(_longest(path, rates), rate, "")
    device = request.device
    if is_table_file(path):
        table = table_of_file(path)
        axis = _axis_of(path, request.axis, tuple(table.columns.axes))
        rate_hz = device.rate_hz or table.rate_hz
        if not rate_hz:
            raise UsageError(f"{path} does not say its sample rate; give --rate")
        values = np.asarray(table.columns.axes[axis], np.float64)
        return _Series(_longest(path, values), rate_hz, unit_of(axis))
    device = settings_of(path, device)
    parts: list[Floats] = []
    info: StreamInfo | None = None
    clock, index = Clock(), 0
    for event in events_of(
        path, Decoding(device.for_wire(), device.wire), request.quiet, "reading"
    ):
        match event:
            case StreamInfo():
                if info is None:
                    info, clock = event, Clock.of(event)
                number = info.axes.index(_axis_of(path, request.axis, info.axes))
            case Block() if info is not None:
                clock.update(index, event.ticks)
                index += len(event)
                parts.append(event.counts[:, number] * info.scale[number])
            case Gap():
                clock.gap(event)
                index += event.lost or 0
                parts.append(np.array([np.nan]))
    if info is None or not parts:
        raise InputError(f"{path} contains no samples")
    axis = info.axes[number]
    rate_hz = clock.rate().hz or info.nominal_hz  # measured, as that of an analysis
    return _Series(_longest(path, np.concatenate(parts)), rate_hz, unit_of(axis))


def _axis_of(path: Path, wanted: str, axes: tuple[str, ...]) -> str:
    if wanted and wanted not in axes:
        raise UsageError(f"{path} has no axis {wanted}; it has {' '.join(axes)}")
    return wanted or axes[0]


def _single_column(path: Path) -> Floats | None:
    """Return the numbers of text that has one on each line, under any heading; None for others."""
    if path.is_dir() or is_table_file(path) or is_recording(path):
        return None
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        return None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    cells = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    numbers = [row for row in cells if row[0][:1].isdecimal() or row[0][:1] in "+-.nN"]
    try:
        values = np.array([float(*row) for row in numbers])
    except (TypeError, ValueError):
        return None
    return values if values.size > 1 else None


def _longest(path: Path, values: Floats) -> Floats:
    """Return the longest run of finite values; say so where there are several."""
    finite = np.isfinite(values)
    if finite.all():
        return values
    edges = np.flatnonzero(np.diff(np.concatenate([[0], finite.astype(np.int8), [0]])))
    starts, stops = edges[::2], edges[1::2]
    best = int(np.argmax(stops - starts))
    longest = count(int(stops[best] - starts[best]))
    print_error(f"{path} has gaps: the longest stretch, {longest} samples, is used")
    return values[starts[best] : stops[best]]


def draw_chart(name: str, out: Path, device: DeviceSettings) -> None:
    """Draw a chart of the method as SVG and PNG: ``transfer``, ``slopes`` or ``chain``."""
    from allanscope.report import chain_picture, slopes_picture, transfer_picture

    if name == "chain":
        picture = chain_picture(chain_steps(device))
    else:
        picture = slopes_picture() if name == "slopes" else transfer_picture()
    try:
        picture.save(out.with_suffix(""))
    except OSError as error:
        raise UsageError(f"cannot write {out}: {error.strerror}; choose another place") from None


def chain_steps(device: DeviceSettings) -> list[ChainStep]:
    """Return the chain of a device, with the numbers that the program works with."""
    from allanscope.report import processing_chain

    part = part_named(device.part or "LSM6DSM")
    rate = device.rate_hz or 104.0
    dps, g = device.gyro_fs or 125.0, device.accel_fs or 2.0
    step, accel_step = 1e3 * part.gyro_scale(dps), 1e3 * part.accel_scale(g)
    scales = f"{step:.3g} mdps at {dps:g} dps, {accel_step:.3g} mg at {g:g} g"
    history = (
        f"at most {count(FULL_ROWS)} rows: samples for {duration(FULL_ROWS / rate)}, then means"
    )
    return processing_chain(part, rate, scales, history)
