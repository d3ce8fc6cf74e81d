"""Add lines that other axes have: where the frequency is known it need not be searched for.

What shakes a sensor, or couples into it, does so on several axes, and on some of them it is too
faint to be told from the highest of all the peaks that noise makes. At the frequency that another
axis has shown it only has to be told from noise there, as often as lines are asked for: the same
probability of a false one is paid with 10 nats instead of 15 to 20.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from allanscope.explain.candidate import Candidate
from allanscope.explain.effects.drifting_line import DriftingLine
from allanscope.explain.effects.narrowband import Narrowband, band_elsewhere
from allanscope.explain.effects.sinusoid import Sinusoid
from allanscope.explain.gates import judge_as_named
from allanscope.explain.moves import SearchPath
from allanscope.explain.view import View

__all__ = ["KnownLines", "lines_of_others"]

_Line = DriftingLine | Narrowband | Sinusoid
_AGREE, _NARROW = 5.0, 0.02
"""Standard errors within which two frequencies are one; width over frequency of a line up to which
it has the same form on every axis."""


@dataclass(frozen=True)
class KnownLines:
    """Lines that an axis is asked for.

    Attributes
    ----------
    view : View
        The axis, searched by itself.
    lines : tuple of effects
        Of others, the best known first, which it does not have.
    questions : int
        How many are asked on all axes together.
    """

    view: View
    lines: tuple[_Line, ...]
    questions: int

    def added(self, most: int, spent: float) -> View:
        """Return the axis with those of them that pass the gates.

        Parameters
        ----------
        most : int
            Effects that it may have.
        spent : float
            What earlier looks at the same data cost, in nats.
        """
        view, path = self.view, SearchPath()
        for line in self.lines:
            if len(view.accepted) >= most:
                break
            candidate = _elsewhere(view, line, self.questions)
            if candidate.excess <= spent:
                continue
            accepted, why = judge_as_named(view, candidate)
            if accepted is None:
                path.note("add known line", candidate, why)
            else:
                path.accept("add known line", accepted)
                view = view.accept(accepted)
        return replace(view, path=(*view.path, *path.steps))


def lines_of_others(views: Mapping[str, View]) -> dict[str, KnownLines]:
    """Return, for every axis that lacks a line of another, what it is asked for."""
    lines = {axis: _lines(view) for axis, view in views.items()}
    missing = {
        axis: _distinct([one for other in lines if other != axis for one in lines[other]], view)
        for axis, view in views.items()
    }
    questions = sum(map(len, missing.values()))
    return {
        axis: KnownLines(views[axis], those, questions) for axis, those in missing.items() if those
    }


def _elsewhere(view: View, line: _Line, questions: int) -> Candidate:
    if isinstance(line, Sinusoid):
        return line.elsewhere(view, questions)
    return band_elsewhere(view, line.frequency, line.bandwidth, questions)


def _lines(view: View) -> list[_Line]:
    """Return the lines of an axis that are as narrow as to be the same on another."""
    own = (c.effect for c in view.accepted if isinstance(c.effect, _Line))
    return [one for one in own if _width(one) < _NARROW * one.frequency.value]


def _distinct(lines: Sequence[_Line], view: View) -> tuple[_Line, ...]:
    """Return lines of different frequencies, at which an axis has nothing, the best known first."""
    found: list[_Line] = []
    own = [c.effect for c in view.accepted if isinstance(c.effect, _Line)]
    fitted = (line for line in lines if not _is_left_out(line, view))
    for line in sorted(fitted, key=lambda one: one.frequency.error):
        if all(_are_apart(line, other) for other in (*own, *found)):
            found.append(line)
    return tuple(found)


def _is_left_out(line: _Line, view: View) -> bool:
    """Return whether a line is where nothing is fitted: what is there is counted with its range."""
    f, width = line.frequency.value, _width(line)
    return any(low - width <= f <= high + width for low, high in view.excluded)


def _are_apart(line: _Line, other: _Line) -> bool:
    apart = abs(line.frequency.value - other.frequency.value)
    near = _AGREE * (line.frequency.error + other.frequency.error)
    return apart > near + _width(line) + _width(other)


def _width(line: _Line) -> float:
    return 0.0 if isinstance(line, Sinusoid) else line.bandwidth.value
