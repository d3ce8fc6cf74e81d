"""A SensorTile with stock DataLog firmware, simulated."""

from __future__ import annotations

import numpy as np

from allanscope.samples import AXES, Block, StreamInfo
from allanscope.wire.device_side import OneWayEncoder, milli_units, temperatures, times

__all__ = ["DataLogEncoder"]

_ROOM_C = 25.0
_DAY = 24 * 3600 * 100


class DataLogEncoder(OneWayEncoder):
    """Blocks to DataLog text.

    Parameters
    ----------
    clock : bool
        Whether to write version 1.1, with the time of day, instead of version 2.
    """

    def __init__(self, clock: bool) -> None:
        super().__init__(StreamInfo(AXES, (70e-3,) * 3 + (0.061e-3,) * 3, 50.0))
        self._clock = clock

    def encode(self, block: Block) -> bytes:
        """Return one record a row; it always names both sensors, an absent one reads 0."""
        rows = np.arange(len(block))
        seconds = times(block, rows, self._info.nominal_hz)
        degrees = np.nan_to_num(temperatures(block, rows), nan=_ROOM_C)
        per_second = 100 if self._clock else 1000
        stamps = np.round(seconds * per_second).astype(np.int64).tolist()
        values = milli_units(block, self._info).tolist()
        write = _version_1 if self._clock else _version_2
        text = "".join(map(write, stamps, values, degrees.tolist()))
        return text.encode("ascii")


def _version_2(milliseconds: int, values: list[int], degrees: float) -> str:
    gx, gy, gz, ax, ay, az = values
    stamp = (milliseconds + 2**31) % 2**32 - 2**31  # printed with %d: negative after 24.8 days
    return (
        f"TimeStamp: {stamp}\r\n"
        f" Acc_X: {ax}, Acc_Y: {ay}, Acc_Z :{az}\r\n"
        f" Gyro_X:{gx}, Gyro_Y:{gy}, Gyro_Z:{gz}\r\n"
        f" Magn_X:0, Magn_Y:0, Magn_Z:0\r\n"
        f" Press:1013.25, Temp:{degrees:5.2f}, Hum:40.0\r\n"
    )


def _version_1(hundredths: int, values: list[int], degrees: float) -> str:
    gx, gy, gz, ax, ay, az = values
    seconds, cc = divmod(hundredths % _DAY, 100)
    minutes, ss = divmod(seconds, 60)
    hh, mm = divmod(minutes, 60)
    # Whole and hundredths are printed as two integers, each with the sign of the number.
    number = round(degrees * 100)
    sign = "-" if number < 0 else ""
    whole, part = divmod(abs(number), 100)
    lead = f"{sign if whole else ''}{whole}.{sign}{part:02d}"
    return (
        f"\nTimeStamp: {hh:02d}:{mm:02d}:{ss:02d}.{cc:02d}"
        f"\n\rACC_X: {ax}, ACC_Y: {ay}, ACC_Z: {az}"
        f"\n\rGYR_X: {gx}, GYR_Y: {gy}, GYR_Z: {gz}"
        f"\n\rMAG_X: 0, MAG_Y: 0, MAG_Z: 0"
        f"\n\rHUM: 40.00\n\rTEMP: {lead}\n\rPRESS: 1013.25\n\rV: 3700mV Chrg: 80%"
    )
