"""What the loop finds: an effect with its parameters, and the error before and after it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from allanscope.noise.coefficients import Coefficient

__all__ = ["AxisExplanation", "Effect", "Parameter", "ResidualError", "SearchStep"]

_OF_THE_STREAM = frozenset({"clock_error"})
"""Kinds that are the same on every axis, and take nothing out of the data of any."""

_OF_THE_STREAM = frozenset({"clock_error"})
"""Kinds that are the same on every axis, and take nothing out of the data of any."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an effect with its 95 % interval; a name (an axis) has no interval."""

    value: float | str
    lower: float | None = None
    upper: float | None = None
    unit: str = ""


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
    """

    kind: str
    parameters: Mapping[str, Parameter]
    equivalent: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()
    evidence: Mapping[str, Any] = field(default_factory=dict)

    @property
    def of_the_stream(self) -> bool:
        """Whether it is a property of the stream: one finding, though every axis lists it."""
        return self.kind in _OF_THE_STREAM


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
class SearchStep:
    """One hypothesis that was tried.

    Attributes
    ----------
    move : str
        ``add``, ``add pair``, ``add bundle``, ``drop``, ``fold sidebands``, ``replace drift``.
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
        True when what is left is what sampling error leaves.
    hindrance : str
        Why the axis was not searched at all (too short, constant, hidden by its step), with what
        to do; empty when it was. Then the errors are NaN and the coefficients empty.
    remarks : tuple of str
        What the reader must know: too short, constant channel, saturated, detection limits.
    path : tuple of SearchStep
        What the search tried, what it gained, and which gate stopped it.
    failure : str
        The error that ended the search of this axis; empty when there was none.
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

    @property
    def own_effects(self) -> tuple[Effect, ...]:
        """Effects of the axis itself: those that are part of the model of its data."""
        return tuple(effect for effect in self.effects if not effect.of_the_stream)
