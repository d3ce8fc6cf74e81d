"""One row out of records that bring the gyroscope and the accelerometer one at a time.

Both run on one oscillator, but firmware polls them one after the other, so that the two halves of
a sample may come in two messages or on two lines.
"""

from __future__ import annotations

import math

__all__ = ["Pairing", "Triple"]

Triple = tuple[float, float, float]

_ALONE = 8
_ABSENT = (math.nan,) * 3


class Pairing:
    """Halves of samples to rows of six values."""

    def __init__(self) -> None:
        self._gyro: Triple | None = None
        self._accel: Triple | None = None
        self._without_gyro = 0
        self._without_accel = 0

    def take(self, gyro: Triple | None, accel: Triple | None) -> tuple[float, ...] | None:
        """Take what came and return the row that it completes.

        A sensor that the last eight records of the other did not bring is switched off: rows then
        have NaN in its place. Before that, half a sample without its partner is given up.
        """
        if gyro is not None:
            self._gyro = gyro
            self._without_gyro = 0
            self._without_accel += 1
        if accel is not None:
            self._accel = accel
            self._without_accel = 0
            self._without_gyro += 1
        gyro, accel = self._gyro, self._accel
        if gyro is not None and self._without_accel > _ALONE:
            accel = _ABSENT
        elif accel is not None and self._without_gyro > _ALONE:
            gyro = _ABSENT
        if gyro is None or accel is None:
            return None
        self._gyro = self._accel = None
        return (*gyro, *accel)
