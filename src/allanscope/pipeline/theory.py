"""Densities and deviations of tables turned into each other, and charts of the method."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import (
    ROWS,
    density_of_deviation,
    deviation_of_density,
    lags_of_level,
    phase_to_rate_density,
    rate_to_phase_density,
)
from allanscope.atomic_write import write_text
from allanscope.errors import InputError, UsageError
from allanscope.parts import part_named
from allanscope.pipeline.analyse_file import FULL_ROWS
from allanscope.pipeline.settings import DeviceSettings
from allanscope.spectrum import SEGMENT

__all__ = ["QUANTITIES", "chain_steps", "convert_table", "draw_chart"]

QUANTITIES = ("S_y", "S_phi", "L", "adev")
"""One-sided density of the rate, of the phase in rad^2/Hz, half of that in dB, and deviation."""

_IN_SERIES = 3
"""Sensor, converter, clock; every sample then goes to all of the sums."""

Floats = NDArray[np.float64]


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
        Of `QUANTITIES`.
    rate : float or None
        Samples per second: where a density ends; twice the highest frequency if None.
    carrier : float
        In Hz, for S_phi and L; 0 for an angle, whose rate is in rad/s.

    Raises
    ------
    InputError, UsageError
        For a table that cannot be read, or numbers that make no sense.
    """
    x, y = _table(source)
    try:
        if given == "adev":
            f = 1.0 / (np.pi * x[::-1]) if wanted != "adev" else x
            density = density_of_deviation(x, y, f)
        else:
            f, density = x, _as_rate(given, x, y, carrier)
        if wanted == "adev":
            hz = rate or 2.0 * float(f.max())
            last = max(int(np.log2(hz / float(f.min()))), 1)
            m = 2 ** np.arange(last)
            rows = m / hz, deviation_of_density(f, density, m, hz)
        else:
            rows = f, _as(wanted, f, density, carrier)
    except ValueError as error:
        raise UsageError(str(error)) from None
    head = "tau_s" if wanted == "adev" else "f_hz"
    lines = [f"{a:.9g},{b:.9g}" for a, b in zip(*rows, strict=True)]
    write_text(out, "\n".join([f"{head},{wanted}", *lines]) + "\n")


def _table(path: Path) -> tuple[Floats, Floats]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        found = [line.replace(",", " ").replace(";", " ").split() for line in lines]
        rows = [[float(a), float(b)] for a, b, *_ in (r for r in found if _is_numeric(r))]
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: no table of two columns: {error}") from None
    if len(rows) < 2:
        raise InputError(f"{path}: a table needs two rows of numbers or more")
    x, y = np.array(rows).T
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


def draw_chart(name: str, out: Path, device: DeviceSettings) -> None:
    """Draw a chart of the method as SVG and PNG: ``transfer`` or ``chain``."""
    from allanscope.report import chain_picture, transfer_picture

    picture = (
        transfer_picture() if name == "transfer" else chain_picture(chain_steps(device), _IN_SERIES)
    )
    try:
        picture.save(out.with_suffix(""))
    except OSError as error:
        raise UsageError(f"cannot write {out}: {error}") from None


def chain_steps(device: DeviceSettings) -> list[tuple[str, str, str]]:
    """Return the way of a sample to the result, with the numbers that the program works with."""
    part = part_named(device.part or "LSM6DSM")
    rate = device.rate_hz or 104.0
    full = device.gyro_fs or 125.0
    cutoffs = " or ".join(f"{hz:.3g}" for hz in part.cutoffs_hz("gx", rate))
    step = 1e3 * part.gyro_scale(full)
    dense, starts = 64, int(lags_of_level(1, 1)[0])
    rows_s = FULL_ROWS / rate
    return [
        (part.name, f"low-pass at {cutoffs} Hz, {rate:g} samples/s", "N behind the filter"),
        ("converter", f"rounds to {step:.3g} mdps at {full:g} dps", "quantization, saturation"),
        ("clock", "host time of arrivals against samples", "rate, tau = m / rate, clock error"),
        ("Allan bank", f"every term below m = {dense}; above, {starts} starts or more in each tau",
         "ADEV MDEV HDEV, noise type, limits"),
        ("archive", f"at most {ROWS} rows, each twice as long whenever they are full",
         "totals, THEO1, drift"),
        ("spectrum", f"segments of {SEGMENT}, each level at a quarter of the rate",
         "density, N reading"),
        ("history", f"means of rows, at most {FULL_ROWS} ({rows_s:.0f} s of single samples)",
         "N B K Q R, effects, residual"),
    ]  # fmt: skip
