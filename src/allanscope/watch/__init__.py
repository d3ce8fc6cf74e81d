"""The watch: what begins at four in the morning is known at four in the morning.

::

    samples ─▶ blocks of a second ─┬▶ level, noise, repeats, rate ─▶ scan ──┐
               (summary)           ├▶ periodogram ─▶ lines ─────────────────┼▶ tracks ─▶ events
                                   └▶ outliers, repeats, losses ─▶ rare ────┘

Each second every axis is asked whether it is still what it was. What an alarm means, and why a
longer night has no more false ones, is in `false_alarms`. An event has the kind of the effect that
the closed loop would name, its moment with an interval, and whether it is still there; what comes
back is the same event once more. Everything depends on the samples alone, in memory that does not
grow: a replay finds the same at the same samples.
"""

from allanscope.watch.events import KINDS, Event, Occurrence
from allanscope.watch.false_alarms import ALPHA
from allanscope.watch.watch import Watch

__all__ = ["ALPHA", "KINDS", "Event", "Occurrence", "Watch"]
