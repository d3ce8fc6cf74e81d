"""The loop while a run goes on: cheap, and honest about having looked before.

Looking at every refresh for twelve hours is 720 looks; a test that errs once in a thousand would
err most nights. So the search runs only when the record has doubled since the last time, and the
k-th such look may spend alpha / 2^k: over a whole run no more than alpha.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from allanscope.clock.rate import RateFit
from allanscope.explain.effect import Effect
from allanscope.explain.loop import Explanation, explain
from allanscope.explain.search import Budget
from allanscope.history import Record

__all__ = ["Finding", "LiveLoop"]

_PLACES = ("frequency", "time", "source", "frequency_low")
"""Parameters that tell two effects of one kind apart."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that was not known at the last look.

    Attributes
    ----------
    axis : str
        Axis it was found on.
    effect : Effect
        What it is.
    at_s : float
        Length of the record when it was found.
    """

    axis: str
    effect: Effect
    at_s: float


@dataclass
class LiveLoop:
    """Run the loop at doubling lengths of a growing record.

    Parameters
    ----------
    first_s : float
        Length of the record at the first look.
    nominal_hz : float, optional
        Sample rate that the device claims.

    Examples
    --------
    ::

        loop = LiveLoop()
        while running:
            for finding in loop.update(history.record(...)):
                print(finding.axis, finding.effect.evidence["words"])
        loop.explanation  # as of the last look
    """

    first_s: float = 120.0
    nominal_hz: float | None = None
    explanation: Explanation | None = None
    looks: int = 0
    _next_s: float = field(default=0.0, repr=False)
    _known: dict[str, list[Effect]] = field(default_factory=dict, repr=False)

    def due(self, record: Record) -> bool:
        """Tell whether the record is long enough for the next look."""
        return len(record.values) / record.rate_hz >= max(self._next_s, self.first_s)

    def update(
        self, record: Record, rate_fit: RateFit | tuple[float, float] | None = None
    ) -> tuple[Finding, ...]:
        """Look at the record if it is time to, and return what is new.

        Parameters
        ----------
        record : Record
            All that is held so far.
        rate_fit : RateFit or (float, float), optional
            Measured rate and its standard error in Hz.
        """
        if not self.due(record):
            return ()
        duration = len(record.values) / record.rate_hz
        self.looks += 1
        self._next_s = 2 * duration
        budget = Budget(spent_nats=self.looks * float(np.log(2)))
        self.explanation = explain(
            record, nominal_hz=self.nominal_hz, rate_fit=rate_fit, budget=budget
        )
        return self._new(self.explanation, duration)

    def _new(self, explanation: Explanation, duration: float) -> tuple[Finding, ...]:
        found: list[Finding] = []
        for axis, result in explanation.axes.items():
            known = self._known.get(axis, [])
            found += [
                Finding(axis, effect, duration)
                for effect in result.effects
                if not any(_same(effect, other) for other in known)
            ]
            self._known[axis] = list(result.effects)
        return tuple(found)


def _same(first: Effect, second: Effect) -> bool:
    """Tell whether two looks speak of one effect: same kind, in the same place."""
    if first.kind != second.kind:
        return False
    name = next((n for n in _PLACES if n in first.parameters), None)
    if name is None or name not in second.parameters:
        return True
    a, b = first.parameters[name].value, second.parameters[name].value
    if isinstance(a, str) or isinstance(b, str):
        return a == b
    return abs(a - b) <= 0.05 * max(abs(a), abs(b))
