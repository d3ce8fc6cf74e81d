"""Time stamps that wrap, made to run on."""

from __future__ import annotations

__all__ = ["Stamps"]


class Stamps:
    """Unwrap a counter of a device's time.

    Parameters
    ----------
    modulus : int
        Where the counter starts over, in its own units: 2^32 for most, a day for a clock.
    per_second : float
        Counts in a second.

    Examples
    --------
    >>> milliseconds = Stamps(1 << 32, 1000.0)
    >>> [milliseconds.seconds(stamp) for stamp in (2147483647, -2147483648, -2147483628)]
    [2147483.647, 2147483.648, 2147483.668]
    """

    def __init__(self, modulus: int, per_second: float) -> None:
        self._modulus = modulus
        self._per_second = per_second
        self._total: int | None = None

    def seconds(self, stamp: int) -> float:
        """Return the unwrapped time; it goes back where the counter does, as after a restart."""
        if self._total is None:
            self._total = stamp
        ahead = (stamp - self._total) % self._modulus
        back = ahead >= self._modulus // 2
        self._total += ahead - self._modulus if back else ahead
        return self._total / self._per_second
