"""The device's clock is off: the true rate against the nominal one.

The sensor's oscillator is trimmed to a few per cent and the host's crystal is good to some tens of
ppm, so a measured rate outside both its own error and twice the host's shows the device's. It
stretches every averaging time: N^2 changes by the relative error, K^2 the other way, lines move.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects.base import ALPHA, EffectKind, estimate
from allanscope.explain.view import View

_CRYSTAL = 1e-4
"""A difference that a host's own crystal (20 to 50 ppm) could make says nothing of the sensor."""


class ClockError(EffectKind):
    """The sample rate is not the nominal one."""

    kind = "clock_error"
    meaning = "the true rate differs from the nominal one"
    needs = frozenset({"clock"})
    stage = 0

    def propose(self, view: View) -> Iterable[Candidate]:
        """Compare the measured rate with the nominal one."""
        clock = view.clock
        assert clock is not None
        if view.has(self.kind) or clock.nominal_hz <= 0:
            return []
        relative = clock.measured_hz / clock.nominal_hz - 1
        error = clock.error_hz / clock.nominal_hz
        if abs(relative) < _CRYSTAL:
            return []
        z = relative / max(error, 1e-12)
        return [
            Candidate(
                kind=self.kind,
                parameters={"relative": estimate(relative, error)},
                gain=float(z**2 / 2),
                price=float(np.log(1 / ALPHA)),
                words=f"the clock runs {1e6 * relative:+.0f} ppm off its nominal rate",
                evidence={"z": float(z)},
                axes=view.series.axes,
            )
        ]
