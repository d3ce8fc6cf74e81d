"""What the integer milli-units of stock ST firmware mean: mdps and mg back to counts.

It sends ``(int32_t)(raw * sensitivity)``: milli-units, cut towards zero (`truncate`). Where the
sensitivity is above one unit (any gyroscope range: 4.375 mdps and more) two counts never give the
same number, so the count can be had back exactly (`recover`). Below (0.061 mg) it is lost.

The numbers also give the sensitivity away: at 2000 dps all of them are multiples of 70.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from allanscope.parts import GYRO_SCALES, part_named
from allanscope.samples import AXES, Block, StreamInfo
from allanscope.wire.base import WireSettings
from allanscope.wire.rows import HELD, Interpretation, Row, Values, nominal_rate

__all__ = ["MilliUnits", "fits", "milli_of", "recover", "to_milli_units", "truncate"]

_USUAL_FULL_SCALE = 2000.0
_FEWEST_LEVELS = 6


def milli_of(full_scale_dps: float) -> float:
    """Return mdps per count; UsageError for a full scale that these parts do not have."""
    return round(part_named("LSM6DSM").gyro_scale(full_scale_dps) * 1e3, 6)


class MilliUnits:
    """Decide what rows of integers in mdps and mg mean, and never forget what was ruled out.

    A gyroscope of stock firmware stands at 2000 dps unless the user says otherwise; when the
    numbers contradict that, the coarsest range that they allow is taken, and if there is none they
    are left as they are.

    Parameters
    ----------
    wire : str
        Name of the format.
    settings : WireSettings
        The full scale of the gyroscope and the rate, where the user gave them.
    usual_rates : tuple of float
        Rates that this firmware has.
    time_resolution_s : float
        Step of its time stamps.
    accel_choices : tuple of float
        Sensitivities in mg per count that are coarse enough to be seen in the numbers.
    polled : bool
        Whether this firmware reads the sensor by a timer of its own.
    """

    def __init__(
        self,
        wire: str,
        settings: WireSettings,
        usual_rates: tuple[float, ...],
        time_resolution_s: float,
        accel_choices: tuple[float, ...] = (),
        polled: bool = False,
    ) -> None:
        self._wire = wire
        self._polled = polled
        self._settings = settings
        self._usual_rates = usual_rates
        self._time_resolution_s = time_resolution_s
        first = milli_of(settings.gyro_fs or _USUAL_FULL_SCALE)
        finer = sorted((milli_of(fs) for fs in GYRO_SCALES), reverse=True)
        self._gyro = [first, *(m for m in finer if m < first)]
        self._accel = list(accel_choices)
        self._epoch = 0

    def decide(self, rows: list[Row]) -> Interpretation:
        """Return what rows of six values mean, those of an absent sensor being NaN."""
        values = np.array([row.values for row in rows])
        columns = np.flatnonzero(np.isfinite(values[0]))
        gyro, accel = columns[columns < 3], columns[columns >= 3]
        whole = np.isfinite(values[:, columns]).all(axis=1)
        sent = np.nan_to_num(values[whole]).astype(np.int64)
        # One damaged row of text must not decide; but once a decision has failed, all count.
        exceptions = 0 if self._epoch else len(rows) // HELD
        _narrow(self._gyro, sent[:, gyro], exceptions)
        _narrow(self._accel, sent[:, accel], exceptions)
        gyro_milli = self._gyro[0] if self._gyro else 1.0
        enough = len(np.unique(np.abs(sent[:, accel]))) >= _FEWEST_LEVELS
        accel_milli = self._accel[0] if self._accel and enough else 1.0
        milli = np.array([gyro_milli] * len(gyro) + [accel_milli] * len(accel))
        self._epoch += 1
        info = StreamInfo(
            axes=tuple(AXES[i] for i in columns),
            scale=tuple(float(f"{m * 1e-3:.6g}") for m in milli),
            nominal_hz=self._settings.rate_hz or nominal_rate(rows, self._usual_rates),
            part=self._settings.part,
            wire=self._wire,
            polled=self._polled,
            time_resolution_s=self._time_resolution_s,
            device_clock=True,
            epoch=self._epoch,
            truncated=tuple(bool(m == 1.0) for m in milli),
        )
        return Interpretation(
            info,
            lambda new: _convert(new, columns, milli),
            lambda odd: self._fits_another(odd, columns),
        )

    def _fits_another(self, odd: Values, columns: NDArray[np.int64]) -> bool:
        """Return whether rows have other axes, or steps of a finer range, all of them."""
        if not np.isfinite(odd[:, columns]).all():
            return bool((np.isfinite(odd) == np.isfinite(odd[0])).all())
        sent = odd[:, columns[columns < 3]].astype(np.int64)
        return sent.size > 0 and any(fits(sent, m).all() for m in self._gyro[1:])


def _narrow(choices: list[float], sent: NDArray[np.int64], exceptions: int) -> None:
    """Strike out the sensitivities that cannot have made these rows, but for a few."""
    misfits = {m: int((~fits(sent, m).all(axis=1)).sum()) for m in choices}
    choices[:] = [m for m in choices if misfits[m] <= exceptions]


def _convert(
    values: Values, columns: NDArray[np.int64], milli: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Return counts, and which rows have these axes and fit these steps."""
    sent = np.nan_to_num(values[:, columns]).astype(np.int64)
    counts = recover(sent, milli)
    same_axes = (np.isfinite(values) == np.isin(np.arange(6), columns)).all(axis=1)
    same_steps = (truncate(counts, milli) == sent).all(axis=1)
    return counts.astype(np.int32), np.asarray(same_axes & same_steps)


def truncate(
    counts: NDArray[np.generic], milli_per_count: float | NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return what stock firmware sends for these counts.

    >>> truncate(np.array([-4, -1, 1, 4]), 8.75).tolist()
    [-35, -8, 8, 35]
    """
    return np.trunc(np.asarray(counts, np.float64) * milli_per_count).astype(np.int64)


def recover(
    sent: NDArray[np.int64], milli_per_count: float | NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return the counts that `truncate` made these numbers of, where there are such counts.

    >>> recover(np.array([-35, -8, 8, 35]), 8.75).tolist()
    [-4, -1, 1, 4]
    """
    size = np.ceil(np.abs(sent) / milli_per_count)
    return (np.sign(sent) * size).astype(np.int64)


def fits(
    sent: NDArray[np.int64], milli_per_count: float | NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return for each number whether some count gives it."""
    same: NDArray[np.bool_] = truncate(recover(sent, milli_per_count), milli_per_count) == sent
    return same


def to_milli_units(block: Block, info: StreamInfo) -> NDArray[np.int64]:
    """Return counts as stock firmware sends them: mdps and mg, cut, shape (n, 6), absent ones 0."""
    sent = np.zeros((len(block), len(AXES)), np.int64)
    columns = [AXES.index(axis) for axis in info.axes]
    sent[:, columns] = truncate(block.counts, np.round(np.asarray(info.scale) * 1e3, 6))
    return sent
