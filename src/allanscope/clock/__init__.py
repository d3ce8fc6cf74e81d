"""The clock: the true sample rate of a run, from sample numbers and the times they were seen.

The axis of every Allan curve is in units of the sample period, and the sensor's oscillator is off
by several per cent; so the nominal rate is never used where one was measured::

    Block.index + Ticks ──▶ Clock ──▶ Envelope (host)   ──▶ fit_line ──┐
                                └───▶ Envelope (device) ──▶ fit_line ──┴──▶ RateFit

An `Envelope` (`clock`) keeps the earliest arrivals, a few hundred however long the run is;
`fit_line` (`rate`) draws a straight line through them that neither stalls nor steps can bend, and
says how well its slope is known. The host's monotonic clock is the truth where there is one, a
device's crystal where there is only a file.
"""

from __future__ import annotations

from allanscope.clock.clock import Clock
from allanscope.clock.rate import DISAGREEMENT, ClockError, LineFit, RateFit

__all__ = ["DISAGREEMENT", "Clock", "ClockError", "LineFit", "RateFit"]
