"""What the loop finds: an effect with its parameters, and the error before and after it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self

from allanscope.noise import Coefficient
from allanscope.quantities import TWO_SIDED_95, measured
from allanscope.worker_process import place_of

if TYPE_CHECKING:  # both bring scipy along, which whoever reads a result can do without
    from allanscope.explain.effects import EffectKind
    from allanscope.noise.components import Component

__all__ = [
    "AxisExplanation",
    "Effect",
    "Estimate",
    "Parameter",
    "ResidualError",
    "SearchStep",
    "Shares",
    "failed",
    "failure_text",
]

_VAGUE = 5.0
"""Standard error of a logarithm beyond which its interval grows no more."""
_LONGEST = 200
"""Characters of an error message that a line has room for."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an effect with its 95 % interval; a name (an axis) has no interval."""

    value: float | str
    lower: float | None = None
    upper: float | None = None
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Estimate(Parameter):
    """A parameter that is a number.

    Examples
    --------
    >>> known = Estimate.of(2.0, 0.5, "s")
    >>> round(known.lower, 2), round(known.upper, 2)
    (1.02, 2.98)
    """

    value: float

    @classmethod
    def of(cls, value: float, error: float, unit: str = "") -> Self:
        """Return it with the 95 % interval of a Gaussian estimate."""
        half = TWO_SIDED_95 * error
        return cls(float(value), float(value - half), float(value + half), unit)

    @classmethod
    def of_log(cls, value: float, error: float, unit: str = "") -> Self:
        """Return a positive number with the 95 % interval of an estimate of its logarithm."""
        factor = math.exp(TWO_SIDED_95 * min(error, _VAGUE))
        return cls(float(value), float(value / factor), float(value * factor), unit)

    @classmethod
    def exact(cls, value: float, unit: str = "") -> Self:
        """Return a number that is known without error."""
        return cls(value, value, value, unit)

    def scaled(self, factor: float) -> Self:
        """Return it times a factor, as well known as it is."""
        lower, upper = (None if end is None else end * factor for end in (self.lower, self.upper))
        return replace(self, value=self.value * factor, lower=lower, upper=upper)

    @property
    def text(self) -> str:
        """Three digits and the unit that people read, without the interval.

        >>> Estimate.exact(0.01952, "dps").text
        '19.5 mdps'
        """
        return measured(self.value, unit=self.unit)

    @property
    def error(self) -> float:
        """Standard error; NaN where there is no interval."""
        if self.lower is None or self.upper is None:
            return math.nan
        return (self.upper - self.lower) / (2 * TWO_SIDED_95)


@dataclass(frozen=True, slots=True)
class Effect:
    """A named thing that the textbook model lacks.

    Attributes
    ----------
    kind : str
        A word of the fixed vocabulary, e.g. ``sinusoid``.
    parameters : mapping
        Name to value, in the vocabulary's names and units.
    equivalent : tuple of str
        Other kinds that this record cannot rule out.
    axes : tuple of str
        All axes on which the same physical effect was seen, this one included.
    evidence : mapping
        What convinced: ``words`` (one sentence) and the numbers it speaks of, such as
        ``held_out_nats``, ``p_value``, ``replicated``.
    brief : str
        A phrase for a line of its own; empty where its parameters say all.
    curve : Component or None
        What has its Allan variance; None where that follows from what it adds to the samples.
    share : float
        Its part of the excess of the axis over sampling error (`Shares`); NaN where there is none.
    given_detection : Parameter or None
        Near the limit, where only what noise makes larger is seen: the size corrected for that;
        None where the selection changes nothing.
    """

    kind: str
    parameters: Mapping[str, Parameter]
    equivalent: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()
    evidence: Mapping[str, Any] = field(default_factory=dict)
    brief: str = ""
    curve: Component | None = None
    share: float = math.nan
    given_detection: Parameter | None = None

    @property
    def traits(self) -> type[EffectKind]:
        """Its kind, which declares the words and the traits that all of one kind share."""
        return _kinds()[self.kind]

    @property
    def rivals(self) -> tuple[type[EffectKind], ...]:
        """The kinds that this record cannot rule out, its own first."""
        return tuple(_kinds()[kind] for kind in (self.kind, *self.equivalent))


def _kinds() -> Mapping[str, type[EffectKind]]:
    from allanscope.explain.effects import KINDS

    return KINDS


@dataclass(frozen=True, slots=True)
class ResidualError:
    """How far one model is from the data of one axis.

    Attributes
    ----------
    chi2_per_dof, p_value : float
        Of the log-deviation residual with the full covariance between taus.
    rms_percent, expected_rms_percent : float
        Of measured / model - 1 over taus, and what sampling alone leaves.
    worst_band_z : float
        Of the whitened spectrum, the band farthest from 1, in its own standard deviations.
    """

    chi2_per_dof: float
    p_value: float
    rms_percent: float
    expected_rms_percent: float
    worst_band_z: float


@dataclass(frozen=True, slots=True)
class Shares:
    """What became of the excess of an axis over sampling error; the three parts add up to 1.

    Attributes
    ----------
    excess_nats : float
        Log-likelihood that could be gained over the textbook model until only sampling error is
        left, in the spectrum and, where an effect shows there alone, in time or distribution.
    named : float
        Part of it that the effects with a name hold.
    nameless : float
        Part of the smooth remainder and of what is ``unexplained``.
    left : float
        Part that the final model does not describe. All three are NaN where there is no excess.
    """

    excess_nats: float
    named: float
    nameless: float
    left: float

    @classmethod
    def none(cls) -> Self:
        """Return those of an axis on which sampling error is all there is."""
        return cls(0.0, math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class SearchStep:
    """One hypothesis that was tried.

    Attributes
    ----------
    move : str
        ``add``, ``add pair``, ``add bands``, ``add beside``, ``add bundle``, ``drop``,
        ``fold sidebands``, ``split``, ``replace drift``, ``resolve``.
    kind, description : str
        The effect.
    gain, penalty : float
        Log-likelihood gained, and what the search for it costs.
    outcome : str
        ``accepted``, or the gate that stopped it.
    """

    move: str
    kind: str
    description: str
    gain: float
    penalty: float
    outcome: str

    def __str__(self) -> str:
        return (
            f"{self.move:15} {self.kind:17} gain {self.gain:9.1f} penalty {self.penalty:5.1f}  "
            f"{self.outcome}: {self.description}"
        )


@dataclass(frozen=True, slots=True)
class AxisExplanation:
    """The closed loop on one axis.

    Attributes
    ----------
    effects : tuple of Effect
        In the order in which they were accepted; those of the stream are on every axis.
    before, after : ResidualError
        Against the textbook model, and against the model with the effects, on the same data.
    coefficients_before, coefficients_after : mapping
        Name (Q N B K R) to Coefficient.
    held_out_nats, held_out_nats_se : float
        Log-likelihood gained on data that was not used to fit, in total, and its standard error.
    explained : bool
        True when the residual is consistent with sampling error.
    hindrance : str
        Why the axis was not searched at all (too short, constant, hidden by its step), with what
        to do; empty when it was. Then the errors are NaN and the coefficients empty.
    remarks : tuple of str
        What the reader must know: too short, constant channel, saturated, detection limits.
    path : tuple of SearchStep
        What the search tried, what it gained, and which gate stopped it.
    failure : str
        The error that ended the search of this axis; empty when there was none.
    shares : Shares or None
        What of the excess over sampling error is named, nameless and left; None where that is not
        known.
    """

    effects: tuple[Effect, ...]
    before: ResidualError
    after: ResidualError
    coefficients_before: Mapping[str, Coefficient]
    coefficients_after: Mapping[str, Coefficient]
    held_out_nats: float
    held_out_nats_se: float
    explained: bool
    remarks: tuple[str, ...] = ()
    hindrance: str = ""
    failure: str = ""
    path: tuple[SearchStep, ...] = ()
    shares: Shares | None = None

    @property
    def own_effects(self) -> tuple[Effect, ...]:
        """Effects of the axis itself: those that are part of the model of its data."""
        return tuple(effect for effect in self.effects if not effect.traits.of_the_stream)


def failure_text(error: Exception) -> str:
    """Return an error in one bounded line.

    >>> failure_text(ZeroDivisionError("weights sum to zero"))
    'ZeroDivisionError: weights sum to zero'
    """
    words = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")
    words = words if len(words) <= _LONGEST else words[: _LONGEST - 1] + "…"
    place = place_of(error)
    return f"{words} ({place})" if place else words


def failed(error: Exception) -> AxisExplanation:
    """Return the explanation of an axis that could not be searched because of an error."""
    unknown = ResidualError(*[math.nan] * 5)
    text = failure_text(error)
    why = f"the search failed: {text}"
    return AxisExplanation(
        effects=(),
        before=unknown,
        after=unknown,
        coefficients_before={},
        coefficients_after={},
        held_out_nats=math.nan,
        held_out_nats_se=math.nan,
        explained=False,
        remarks=(why,),
        hindrance=why,
        failure=text,
    )
