"""The loop while a run goes on: bounded in time, with penalties for repeated searches.

Searching at every refresh for twelve hours is 720 searches; a test that errs once in a thousand
would err most nights. So the search runs only when the record has doubled since the last time, and
the k-th search may spend alpha / 2^k: over a whole run no more than alpha. The searches of a whole
run cost together no more than twice the last one, and that one sees no more rows than the history
keeps, however long the run.

::

    every refresh                       worker thread                     viewer, terminal
    record = history.record(...)
    if loop.due(record): ─────────────▶ findings = loop.update(record) ──▶ finding.words
                                        loop.explanation                   curves before and after
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from allanscope.clock import RateFit
from allanscope.explain.effect import Effect, Parameter, ResidualError
from allanscope.history import Record
from allanscope.spectrum import Density

if TYPE_CHECKING:
    from allanscope.explain.loop import Explanation

__all__ = ["Finding", "LiveLoop"]

_WIDTHS = 3.0
"""Half-widths of both intervals within which two estimates speak of one place."""
_COARSE = 0.02
"""Relative difference that is one place where an estimate has no interval."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that no earlier search had found.

    Attributes
    ----------
    axes : tuple of str
        Axes it was seen on; one physical effect is announced once.
    effect : Effect
        What it is, as found on the first of them.
    at_s : float
        Length of the record when it was found.
    before, after : ResidualError
        Of the first axis: the textbook model, and the model with all that is known by now.
    """

    axes: tuple[str, ...]
    effect: Effect
    at_s: float
    before: ResidualError
    after: ResidualError

    @property
    def words(self) -> str:
        """One line: where, what, and the error before and after."""
        return (
            f"{', '.join(self.axes)}: {self.effect.evidence['words']} "
            f"(curve {self.before.rms_percent:.3g} % off before, "
            f"{self.after.rms_percent:.3g} % after; "
            f"sampling alone {self.after.expected_rms_percent:.3g} %)"
        )


@dataclass
class LiveLoop:
    """Run the loop at doubling lengths of a growing record.

    Parameters
    ----------
    first_s : float
        Length of the record at the first search.
    nominal_hz : float, optional
        Sample rate that the device claims.

    Attributes
    ----------
    explanation : Explanation or None
        Of all axes, as of the last search; None before the first.
    searches : int
        How many searches there were.
    findings : tuple of Finding
        All that were announced, in order.

    Notes
    -----
    `update` takes some seconds when a long record is due and releases the interpreter while it
    computes: call it in a worker thread, one call at a time.

    Examples
    --------
    ::

        loop = LiveLoop(nominal_hz=104.0)
        while running:
            record = history.record(rate_hz, axes, scale)
            if loop.due(record):
                for finding in loop.update(record, rate_fit=clock.rate()):
                    print(finding.words)
    """

    first_s: float = 120.0
    nominal_hz: float | None = None
    explanation: Explanation | None = None
    searches: int = 0
    findings: tuple[Finding, ...] = ()
    _next_s: float = field(default=0.0, repr=False)

    def due(self, record: Record) -> bool:
        """Return whether the record is long enough for the next search: costs nothing."""
        return _length_s(record) >= max(self._next_s, self.first_s)

    def update(
        self,
        record: Record,
        rate_fit: RateFit | tuple[float, float] | None = None,
        densities: Mapping[str, Density] | None = None,
    ) -> tuple[Finding, ...]:
        """Search the record if it is time to, and return what is new.

        Parameters
        ----------
        record : Record
            All that is held so far.
        rate_fit : RateFit or (float, float), optional
            Measured rate and its standard error in Hz.
        densities : mapping of str to Density, optional
            Density of each axis: what there is above the rows of a long run.
        """
        if not self.due(record):
            return ()
        from allanscope.explain.loop import explain
        from allanscope.explain.search import Budget

        self.searches += 1
        self._next_s = 2 * _length_s(record)
        self.explanation = explain(
            record,
            densities,
            nominal_hz=self.nominal_hz,
            rate_fit=rate_fit,
            budget=Budget(spent_nats=self.searches * math.log(2)),
        )
        new = self._new(self.explanation, _length_s(record))
        self.findings += new
        return new

    def _new(self, explanation: Explanation, at_s: float) -> tuple[Finding, ...]:
        found: list[Finding] = []
        for axis, result in explanation.axes.items():
            for effect in result.effects:
                known = (*self.findings, *found)
                if not any(axis in f.axes and _same(effect, f.effect) for f in known):
                    axes = tuple(sorted({axis, *effect.axes}, key=list(explanation.axes).index))
                    found.append(Finding(axes, effect, at_s, result.before, result.after))
        return tuple(found)


def _length_s(record: Record) -> float:
    return len(record.values) / record.rate_hz


def _same(first: Effect, second: Effect) -> bool:
    """Return whether two searches found one effect: same kind, in the same place."""
    if first.kind != second.kind or not (place := first.traits.located_by):
        return first.kind == second.kind
    a, b = first.parameters[place], second.parameters[place]
    if isinstance(a.value, str) or isinstance(b.value, str):
        return a.value == b.value
    room = _WIDTHS * (_half_width(a) + _half_width(b))
    return abs(a.value - b.value) <= max(room, 1e-4 * abs(a.value))


def _half_width(parameter: Parameter) -> float:
    if parameter.lower is None or parameter.upper is None:
        assert isinstance(parameter.value, float)
        return _COARSE / (2 * _WIDTHS) * abs(parameter.value)
    return (parameter.upper - parameter.lower) / 2
