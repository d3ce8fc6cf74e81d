"""The device's clock is off: the true rate against the nominal one.

The oscillator of these parts is trimmed to a few per cent by design, so a difference is the rule
and no fault. It is reported all the same, because it is real and what it does is not small: taken
at the nominal rate every averaging time is stretched, N^2 changes by the relative error, K^2 the
other way, lines move. Here nothing has to be taken out of the data, for all frequencies and times
are those of the measured rate; so the effect is a statement about the device (found once, listed
with all axes), costs the residual nothing, and an axis that has it alone counts as one without any.

It takes a better clock to see it: the host's, good to some tens of ppm, or time stamps that are not
the sensor's own. Without one, as in an array or a table without times, nothing is said. With one,
the difference must stand out of the error of the measured rate (z^2/2 nats against the price of one
look) and be more than a host's crystal may be wrong by.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from allanscope.explain.candidate import Candidate
from allanscope.explain.effect import Estimate
from allanscope.explain.effects import EffectKind
from allanscope.explain.view import Clock, View
from allanscope.quantities import number

_CRYSTAL = 1e-4
"""A difference that a host's own crystal (20 to 50 ppm) could make says nothing of the sensor."""


@dataclass(frozen=True)
class ClockError(EffectKind):
    """The sample rate is not the nominal one."""

    relative: Estimate
    measured_hz: float
    nominal_hz: float
    z: float

    kind = "clock_error"
    meaning = "the true rate differs from the nominal one"
    needs = frozenset({"clock"})
    stage = 0
    is_single = True
    of_the_stream = True

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        ppm = 1e6 * abs(self.relative.value)
        side = "above" if self.relative.value > 0 else "below"
        return (
            f"the true rate is {self.measured_hz:.6g} Hz, {ppm:.0f} ppm {side} the nominal "
            f"{self.nominal_hz:.6g} Hz; all times and frequencies use the true rate"
        )

    @property
    def brief(self) -> str:
        """How fast or slow the clock is."""
        relative = self.relative.value
        return f"clock {number(100 * abs(relative))} % {'fast' if relative > 0 else 'slow'}"

    @classmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Compare the measured rate with the nominal one."""
        assert view.clock is not None
        found = clock_error_of(view.clock, view.series.axes)
        return [] if found is None else [found]


def clock_error_of(clock: Clock, axes: tuple[str, ...]) -> Candidate | None:
    """Return what a clock says of all axes; None where a host's crystal may be as wrong."""
    if clock.nominal_hz <= 0:
        return None
    relative = clock.measured_hz / clock.nominal_hz - 1
    error = clock.error_hz / clock.nominal_hz
    if abs(relative) < _CRYSTAL:
        return None
    z = float(relative / max(error, 1e-12))
    effect = ClockError(Estimate.of(relative, error), clock.measured_hz, clock.nominal_hz, z)
    return Candidate(effect, z**2 / 2, axes=axes)
