"""The library of effects: one file a kind, each registers itself by being imported.

To add a kind:

1. Write ``effects/<kind>.py`` with one frozen dataclass that is a subclass of `EffectKind`, or of
   `SizedSignal` for a slow signal of known form. Its docstring holds the theory: what happens
   physically, the equation, where it shows first, what it is confused with and what tells the two
   apart. Its fields are the numbers of one effect: each `Estimate` is a reported parameter with its
   95 % interval and its unit, all others are evidence. ``words`` says them in a phrase. Declare
   ``kind``, ``meaning``, ``needs``, ``stage``, ``confused_with`` and the traits it has.
2. ``propose(view)`` looks where it shows (`View.ordinates`, `View.power`, `View.innovations`, other
   axes) and yields candidates. The noise is refitted with each: `joint_fit` for a signal given in
   time, `SpectrumFitter` with one more component for a process. ``gain`` is the difference of two
   maximised log-likelihoods, ``log_alternatives`` the log of the number of alternatives that were
   looked at. Estimate both on clean records: at most one in 1000 (`candidate.ALPHA`) may gain more
   than the penalty, the log of (alternatives / alpha).
3. ``refine(view)`` estimates the numbers again once other effects are known, ``adequate`` tells
   whether it is what its name says, and ``hold_out(view, candidate)`` judges the numbers on data
   that was not used (`heldout`).
4. If one physical effect can be seen on several axes at once, declare the parameter in which they
   agree as ``shared_by``; if simulated sensors should have it, add an effect to
   ``simulator/effects``.
5. Test it at fixed seeds in ``tests/explain``: present, clean, against each of ``confused_with``,
   and near the limit; then add it to ``benchmarks/blind_generator.py`` and run the blind benchmark.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from importlib import import_module
from itertools import combinations
from pkgutil import iter_modules
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray

from allanscope.explain.candidate import Candidate, HeldOut
from allanscope.explain.effect import Estimate, Parameter
from allanscope.explain.heldout import halves, interleaved
from allanscope.explain.regression import joint_fit, marginal_covariance
from allanscope.explain.view import Span, View
from allanscope.noise.components import Component
from allanscope.noise.grid import Grid

__all__ = [
    "KINDS",
    "VOCABULARY",
    "EffectKind",
    "PlacedSignal",
    "SizedSignal",
    "errors_at",
    "is_alike",
]

Array = NDArray[np.float64]

_ALIKE = 1.5
"""Ratio up to which two time constants are the same."""
_SINGULAR = 1e-6
"""Least eigenvalue of a correlation matrix that is not rounding."""

KINDS: dict[str, type[EffectKind]] = {}
"""Every kind by name, in the order in which the files of the folder are read."""


@dataclass(frozen=True)
class EffectKind(ABC):
    """One kind of effect; an instance is one effect of that kind, with its numbers.

    A subclass is a frozen dataclass. Its fields that are `Parameter` are reported as the parameters
    of the effect, all others as evidence. The class declares what the loop asks of a kind.

    Attributes
    ----------
    kind : str
        Its word in the vocabulary.
    meaning : str
        One line for people.
    phrase : str
        What is said of it as a finding: ``{name}`` is a parameter, ``{event}`` when it begins and
        ends. Empty: its name.
    as_cause : str
        What is said of it as the cause of something. Empty: its name.
    needs : frozenset of str
        What it must be given: ``samples`` (rows that are single samples), ``temperature``,
        ``axes`` (more than one), ``clock``.
    stage : int
        Kinds of a lower stage are settled first: faults of the data before its physics, and what
        is judged on whitened data after everything that colours it.
    confused_with : mapping
        Other kind to what tells the two apart.
    excluded_by : frozenset of str
        Kinds beside which it is not looked for.
    located_by : str
        Parameter that tells two effects of this kind on one axis apart; empty where there can be
        one.
    sized_by : str
        Parameter that it is as large as; empty where there is none.
    size_of_none : float
        Its value where there is no effect.
    shared_by : str
        Parameter in which several axes agree where one physical effect is seen on all of them;
        empty where every axis has its own.
    is_single : bool
        Whether an axis has it once at most, a warm-up perhaps with two time constants.
    is_named : bool
        Whether it says what it is, so that an axis that has it may be explained.
    is_process : bool
        Whether it is a part of the spectrum: it must recur in both halves of the record.
    is_slow : bool
        Whether it is one of those that pass together though none passes alone (`moves.add`).
    is_drift, is_piecewise : bool
        Whether it may be a piece of a drift without a name, or of a relaxation without one.
    is_line : bool
        Whether it shows as a line in the spectrum.
    is_coupling : bool
        Whether it is what another axis measures, so that it may be asked which is the source.
    is_counted : bool
        Whether there may be several: "a line", but "narrow-band noise".
    motion : str
        How an event moves the board: ``shift`` of the level, ``burst``; empty of what is no event.
    has_one_cause : bool
        Whether one cause stands behind it on all axes, however large it is on each.
    acts_fast, acts_slow : bool
        Whether it changes the deviation at short averaging times, where N is read, or at long ones.
    is_thermal : bool
        Whether it shares the level with the temperature (`moves.add`).
    is_coefficient : bool
        Whether it is one of the textbook's coefficients, which take part in the competition and are
        no effects.
    is_rival : bool
        Whether it may be named as what an effect could be instead.
    is_fitted : bool
        Whether its numbers maximise a likelihood, as those of every process do: each must then have
        an interval.
    resembles_bend : bool
        Whether a level that follows the temperature in a curve may look like it.
    is_not_gaussian : bool
        Whether beside it the innovations are not a Gaussian's.
    of_the_stream : bool
        Whether it is the same on every axis, and takes nothing out of the data of any.
    removes_rows : bool
        Whether it takes its rows out of an axis, and out of others that this axis may follow.
    repeats_rows : bool
        Whether its ``fraction`` is that of rows which repeat the row before.
    must_replicate : bool
        Whether the quarters of a record must agree on it.
    """

    kind: ClassVar[str]
    meaning: ClassVar[str]
    phrase: ClassVar[str] = ""
    as_cause: ClassVar[str] = ""
    needs: ClassVar[frozenset[str]] = frozenset()
    stage: ClassVar[int] = 2
    confused_with: ClassVar[Mapping[str, str]] = {}
    excluded_by: ClassVar[frozenset[str]] = frozenset()
    located_by: ClassVar[str] = ""
    sized_by: ClassVar[str] = ""
    size_of_none: ClassVar[float] = 0.0
    shared_by: ClassVar[str] = ""
    is_single: ClassVar[bool] = False
    is_named: ClassVar[bool] = True
    is_process: ClassVar[bool] = False
    is_slow: ClassVar[bool] = False
    is_drift: ClassVar[bool] = False
    is_piecewise: ClassVar[bool] = False
    is_line: ClassVar[bool] = False
    is_coupling: ClassVar[bool] = False
    is_counted: ClassVar[bool] = False
    motion: ClassVar[Literal["", "shift", "burst"]] = ""
    has_one_cause: ClassVar[bool] = False
    acts_fast: ClassVar[bool] = True
    acts_slow: ClassVar[bool] = True
    is_thermal: ClassVar[bool] = False
    is_coefficient: ClassVar[bool] = False
    is_rival: ClassVar[bool] = True
    is_fitted: ClassVar[bool] = False
    resembles_bend: ClassVar[bool] = False
    is_not_gaussian: ClassVar[bool] = False
    of_the_stream: ClassVar[bool] = False
    removes_rows: ClassVar[bool] = False
    repeats_rows: ClassVar[bool] = False
    must_replicate: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "kind" in cls.__dict__:
            KINDS[cls.kind] = cls

    @classmethod
    @abstractmethod
    def propose(cls, view: View) -> Iterable[Candidate]:
        """Return candidates that would explain part of the residual, the noise refitted."""

    @classmethod
    def has_place(cls, view: View) -> bool:
        """Return whether what is known already leaves it a place."""
        taken = cls.is_single and view.has(cls.kind)
        return not (taken or (cls.is_drift and view.drifts) or any(map(view.has, cls.excluded_by)))

    @classmethod
    def candidates(cls, view: View) -> list[Candidate]:
        """Return what it proposes, finished; nothing where it has no place."""
        return [one.finished() for one in cls.proposed(view)]

    @classmethod
    def proposed(cls, view: View) -> list[Candidate]:
        """Return what it proposes, as far as ranking needs it; asked once of a view."""
        if cls not in view.proposed:
            view.proposed[cls] = tuple(cls.propose(view)) if cls.has_place(view) else ()
        return list(view.proposed[cls])

    @classmethod
    def available(cls, view: View) -> bool:
        """Return whether the record has what this kind needs."""
        has = {
            "samples": view.series.stride == 1,
            "temperature": view.series.thermal is not None,
            "axes": len(view.series.axes) > 1,
            "clock": view.clock is not None,
        }
        return all(has[need] for need in cls.needs)

    @property
    def words(self) -> str:
        """What it is, in a phrase."""
        return self.meaning

    @property
    def form_price(self) -> float:
        """Nats of its price that were paid for its form: a simpler one was found for less."""
        return 0.0

    @property
    def brief(self) -> str:
        """A phrase for a line of its own; empty where the parameters say all."""
        return ""

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Name to value of what is reported of it."""
        return {n: v for n, v in self._fields().items() if isinstance(v, Parameter)}

    @property
    def evidence(self) -> dict[str, Any]:
        """What else it knows of itself."""
        return {
            n: v
            for n, v in self._fields().items()
            if not isinstance(v, Parameter) and v is not None
        }

    def _fields(self) -> dict[str, Any]:
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @property
    def curve(self) -> Component | None:
        """The component that has its Allan variance; None where that follows from its signal."""
        return None

    @property
    def is_unnamed_drift(self) -> bool:
        """Whether it is a slow drift without a name."""
        return False

    @property
    def shows_in_distribution(self) -> bool:
        """Whether it shows in the distribution of the samples, and not in their spectrum."""
        return False

    @property
    def spans(self) -> tuple[Span, ...]:
        """From and until when it is there, in s, where that is a part of the record only."""
        return ()

    @property
    def wave_hz(self) -> tuple[float, ...]:
        """Frequencies at which it has power, where it is one wave all along and no noise."""
        return ()

    @property
    def relaxation(self) -> Estimate | None:
        """Time constant of a relaxation, None for anything else."""
        return None

    def with_relaxation(self, time_constant: Estimate) -> Self:
        """Return a relaxation with another time constant."""
        return replace(self, **{"time_constant": time_constant})

    def waves(self, view: View) -> float:
        """Return how many waves of it the record holds: without end for what is no wave."""
        del view
        return float("inf")

    def from_end_s(self, view: View) -> float | None:
        """Return how far from an end of the record it changes the level; None where it does not."""
        del view
        return None

    def local_power(self, view: View) -> float:
        """Return how many times too much it gains, as the noise around it is louder than the rest.

        1 for what has no place in time.
        """
        del view
        return 1.0

    def refine(self, view: View) -> Candidate | None:
        """Estimate an accepted effect again, given everything else that was accepted.

        `view` is without this effect. None leaves it as it is.
        """
        del view
        return None

    def prolong(self, view: View, candidate: Candidate) -> Candidate:
        """Return an accepted effect on a record that has grown since, not searched for again.

        `view` is the record without it; the signal of the candidate has been brought to the rows
        of the view, and its last value stays for what is new. The default leaves it at that.
        """
        del view
        return candidate

    def adequate(self, view: View, candidate: Candidate) -> Candidate | None:
        """Return the candidate if it is what its name says, `unexplained` in its place, or None."""
        del view
        return candidate

    def is_resolved(self, view: View) -> bool:
        """Return whether the record can tell it from what was accepted already."""
        del view
        return True

    def refuses(self, view: View, known: Candidate, other: Candidate) -> str:
        """Return why a candidate has no place beside this one, `known`; empty where it has."""
        del view, known, other
        return ""

    @classmethod
    def instead_of(cls, view: View, candidate: Candidate) -> Candidate | None:
        """Return one of this kind that another only looks like; None where there is none."""
        del view, candidate
        return None

    def holds(self, other: EffectKind) -> bool:
        """Return whether another effect, if it is there, may be all that there is to this one."""
        del other
        return False

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut | None:
        """Judge the candidate on data that was not used to fit it; None where nothing can be.

        A process is fitted on one half of the record and judged on the other.
        """
        return halves(view, candidate) if self.is_process else None

    def columns(self, view: View) -> Array | None:
        """Return the first ordinates of what a slow signal is a sum of, shape (p, grid.low).

        One column a number: the signal is linear in them around the candidate. None for what is
        not deterministic, or not slow: that is estimated on its own.
        """
        del view
        return None

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return the candidate with the amplitudes that a joint regression gave its columns.

        It is to be finished: the signal is made once the last of several regressions is done.
        """
        del view, amplitude, covariance
        return candidate

    def goes_along(self, other: Self) -> bool:
        """Return whether one on another axis, alike in what they share, may have the same cause."""
        del other
        return True

    def is_same(self, other: Self, grid: Grid) -> bool:
        """Return whether another effect of this kind is the same hypothesis."""
        del other, grid
        return True


@dataclass(frozen=True)
class SizedSignal(EffectKind):
    """A slow signal of known form in time, of which the size is fitted together with the noise.

    What `propose` puts into the field of the size before it was fitted is only its unit.
    """

    is_slow = True

    @abstractmethod
    def form(self, view: View) -> Array:
        """Return the signal of size 1, shape (n,)."""

    @abstractmethod
    def columns(self, view: View) -> Array:
        """Return its first ordinates, shape (1, grid.low)."""

    @property
    def _factor(self) -> Estimate:
        """What the form is multiplied by."""
        size: Estimate = getattr(self, self.sized_by)
        return size

    def signal(self, view: View) -> Array:
        """Return the signal of its size, shape (n,)."""
        return self._factor.value * self.form(view)

    def measured(self, view: View, log_alternatives: float) -> Candidate:
        """Fit the size and the noise together."""
        return self.ranked(view, log_alternatives).finished()

    def ranked(self, view: View, log_alternatives: float) -> Candidate:
        """Return `measured` to be finished: with the gain alone."""
        columns = self.columns(view)
        fit = joint_fit(view, columns)

        def finish() -> tuple[EffectKind, Array | None]:
            covariance = marginal_covariance(view, columns, fit)
            done = self.solved(view, bare, fit.amplitude, covariance).finished()
            return done.effect, done.signal

        bare = Candidate(self, fit.gain, log_alternatives)
        return replace(bare, finish=finish)

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return the candidate with the size that a regression found."""
        size = Estimate.of(float(amplitude[0]), float(np.sqrt(covariance[0, 0])), self._factor.unit)
        sized = replace(self, **{self.sized_by: size})
        return candidate.solved(sized, partial(sized.signal, view))

    def hold_out(self, view: View, candidate: Candidate) -> HeldOut | None:
        """Judge the size by interleaved blocks."""
        del candidate
        columns = self.columns(view)
        fit, again = joint_fit(view, columns), self.must_replicate
        return interleaved(view, fit, columns, recurs=again, slow=self.is_slow)


@dataclass(frozen=True)
class PlacedSignal(SizedSignal):
    """One whose place was searched for: where it fits best it looks larger than it is (`Place`).

    Attributes
    ----------
    shrinkage, scatter : float
        Mean and standard deviation of the size over the places, as shares of that at the best.
    """

    shrinkage: float = field(default=1.0, kw_only=True)
    scatter: float = field(default=0.0, kw_only=True)

    def solved(
        self, view: View, candidate: Candidate, amplitude: Array, covariance: Array
    ) -> Candidate:
        """Return the candidate with the size that a regression found, over all places."""
        more = (self.scatter * amplitude[0]) ** 2
        return super().solved(view, candidate, self.shrinkage * amplitude, covariance + more)


def is_alike(first: Estimate, second: Estimate) -> bool:
    """Return whether two time constants are alike."""
    return 1 / _ALIKE < first.value / second.value < _ALIKE


def errors_at(loss: Callable[[Array], float], at: Array, step: Array) -> Array:
    """Return the standard errors at the minimum of a negative log-likelihood, from its curvature.

    NaN where it curves downwards in some direction: there is no minimum, and nothing has been
    measured; an error of 0 would claim the opposite.
    """
    rows, least = np.diag(step), loss(at)
    single = [loss(at + row) + loss(at - row) - 2 * least for row in rows]
    information = np.diag(single) / step**2
    for i, j in combinations(range(len(at)), 2):
        both = loss(at + rows[i] + rows[j]) + loss(at - rows[i] - rows[j]) - 2 * least
        mixed = (both - single[i] - single[j]) / (2 * step[i] * step[j])
        information[i, j] = information[j, i] = mixed
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    if not (np.isfinite(information).all() and scale.all()):  # at the end of what it may be
        return np.full(len(scale), np.nan)
    if np.linalg.eigvalsh(information / np.outer(scale, scale))[0] <= _SINGULAR:
        return np.full(len(scale), np.nan)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information))))


for _module in sorted(iter_modules(__path__), key=lambda module: module.name):
    import_module(f"{__name__}.{_module.name}")

VOCABULARY = frozenset(name for name, kind in KINDS.items() if not kind.is_coefficient)
"""Kinds that a result may name; the textbook's coefficients only compete with them."""
