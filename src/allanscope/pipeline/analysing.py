"""`analyse` for Python: whatever holds samples, to the end, as the command of that name does."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from allanscope.analysis import Analysis
from allanscope.pipeline.analyse import analyse_input
from allanscope.pipeline.column_analysis import analyse_columns
from allanscope.pipeline.columns import (
    columns_of_array,
    columns_of_mapping,
    with_units,
)
from allanscope.pipeline.settings import DeviceSettings
from allanscope.recording import Recording

__all__ = ["analyse"]


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
    quiet: bool = True,
) -> Analysis:
    """Return the full result of a recording, a file or arrays: every curve, and the closed loop.

    Parameters
    ----------
    recording_or_arrays
        A path (a recording, the folder of a session, a raw capture, delimited text, a file of
        arrays: .npz, .npy, Parquet); a `Recording`;
        an array of shape (n,) or (n, axes), integers or floats; or a mapping of column names to
        arrays of shape (n,): t, gx gy gz, ax ay az, temp, each alone or with its unit as in
        ``"gx[mdps]"`` (a pandas table and an ``.npz`` file will do as well).
    rate : float, optional
        Nominal sample rate in Hz. Needed where neither the stream nor a column t tells it, and
        above times that disagree with it.
    axes : sequence of str, optional
        Name of each column of an array; without it one is gx, three the gyro, six both sensors;
        where gravity is in the first three these are the accelerometer.
    units : mapping or str, optional
        Unit by axis (``gx``), by sensor (``gyro``, ``accel``) or of all: dps mdps rad/s, g mg
        m/s^2, lsb. Without it integers are counts, floats dps and g; an accelerometer that reads
        9.81 or 1000 at rest is in m/s^2 or mg. `Analysis.assumptions` says so.
    part : str
        LSM6DS3H, LSM6DSL or LSM6DSM: whose datasheet the noise is compared with.
    gyro_fs, accel_fs : float, optional
        Full scales in dps and g, which give counts their scale. Where counts come without, those
        that the parts have after a reset are taken, 250 dps and 2 g, and ``input`` says so.
    wire : str
        Wire format of a capture; found out if not given.
    quiet : bool
        False to show progress while a file is read.

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
        When a file cannot be read or holds no samples.

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
    device = DeviceSettings(part=part, rate_hz=rate, gyro_fs=gyro_fs, accel_fs=accel_fs, wire=wire)
    source: Any = recording_or_arrays
    if isinstance(source, Recording):
        source = source.path
    if isinstance(source, str | os.PathLike):
        if axes is not None or isinstance(units, str):
            raise ValueError("a file names its axes itself; give units as {'gyro': 'mdps'}")
        device = replace(device, units=tuple((units or {}).items()))
        return analyse_input(Path(source), device, quiet)
    if hasattr(source, "keys"):  # a mapping, a table of pandas, an .npz file
        names = list(source.keys() if axes is None else axes)
        columns = columns_of_mapping({str(name): source[name] for name in names})
    else:
        columns = columns_of_array(source, axes)
    return analyse_columns(with_units(columns, units), device, {"name": "arrays"})
