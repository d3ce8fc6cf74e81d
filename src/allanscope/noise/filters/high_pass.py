r"""A high-pass: the level is taken away, and with it whatever is slower than the cutoff.

:math:`|H|^2 = 1 / (1 + (f_c / f)^{2p})`; p = 1 is a coupling capacitor, a bias that an exponential
average follows, or the gravity that a phone takes off its acceleration. It is 1 far above the
corner, so that N stays what the sensor has; what B and K have below it is gone.

Little is left there, and a record of length T ends somewhere: into every cosine ordinate leaks the
difference of the integrals at its two ends, a density of
:math:`2 I / (\pi^2 f_c T)` times that of the noise, with
:math:`I = \int_0^\infty u^{2p-2} / (1 + u^{2p})\,du = \pi / (2p \sin(\pi (2p - 1) / 2p))`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from allanscope.noise.part import Filter, Quantity

__all__ = ["HighPass"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HighPass(Filter):
    """A high-pass with a corner in Hz, at which half the power passes.

    Parameters
    ----------
    corner, slope : float
    length_s : float
        Length of the record.
    """

    corner: float
    slope: float = 1.0
    length_s: float = np.inf
    symbol: ClassVar[str] = "high_pass"
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("corner", "Hz", "shape", 1e-9, 1e7),
        Quantity("slope", "", "shape", 0.55, 20.0),
    )

    def __post_init__(self) -> None:
        self._check_positive()

    def corners(self, dt: float) -> tuple[float, ...]:
        """Return the corner."""
        return (self.corner,) if self.corner < 0.5 / dt else ()

    def response(self, f: Array, dt: float) -> Array:
        """Return 1 / (1 + (corner / f)^(2 slope)), and what leaks in from the ends."""
        del dt
        power = 2 * self.slope
        ratio = (np.asarray(f, np.float64) / self.corner) ** power
        integral = np.pi / (power * np.sin(np.pi * (power - 1) / power))
        leak = 2 * integral / (np.pi**2 * self.corner * self.length_s)
        return np.asarray(ratio / (1 + ratio) + leak)
