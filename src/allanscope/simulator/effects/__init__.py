"""Effects: what real records hold and the textbook model of noise does not.

An effect is a kind with parameters, and a function that alters samples. The modules are what an
effect acts on: `signal`, `noise`, `conversion`. A new effect is a function in one of them that
states the equation, with its name, stage and parameters in the decorator `effect`; nothing else
names it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from allanscope.simulator.noise import stream
from allanscope.simulator.parameters import Parameter

__all__ = [
    "Apply",
    "Conditions",
    "EffectContext",
    "EffectKind",
    "Parameter",
    "Run",
    "Stage",
    "effect",
    "effect_kinds",
]

Stage = Literal["white", "noise", "signal", "coupling", "rounding", "rows", "clock"]
"""Where in the chain an effect acts.

================  =============================================================================
``white``         on the white noise of one axis alone
``noise``         on the sensor's own noise of one axis: white, flicker and random walk together
``signal``        on the output of one axis; this is where most effects are added
``coupling``      on one axis, with sight of what all axes were before any coupling
``rounding``      on the output of one axis, after everything that is added
``rows``          on the counts of some axes at once, after the converter
``clock``         on no sample: it sets the true sample rate
================  =============================================================================
"""


@dataclass(frozen=True, slots=True)
class Run:
    """What is the same for all axes.

    Attributes
    ----------
    seed : int
        Of the device.
    rate_hz : float
        True sample rate.
    duration_s : float
        Length of the record, as far as it is known; for effects that happen a number of times.
    number : int
        Tells the runs of one device apart: the same specimen, other noise.
    """

    seed: int
    rate_hz: float
    duration_s: float
    number: int = 0

    def stream(self, *name: str) -> Generator:
        """Return the random numbers of one process of this run."""
        return stream(self.seed, *((f"run {self.number}",) if self.number else ()), *name)


@dataclass(frozen=True, slots=True)
class EffectContext:
    """What an effect gets when it is set up for one axis.

    Attributes
    ----------
    rate_hz, duration_s : float
        See `Run`.
    onset_s : float
        Time from the start of the record from which the effect acts.
    white_sigma : float
        Standard deviation of the white noise of the axis, per sample.
    lsb : float
        Physical unit per count of the axis.
    source : str
        Another axis, for effects that need one.
    rng : Generator
        Source of randomness of this effect on this axis alone.
    """

    rate_hz: float
    duration_s: float
    onset_s: float
    white_sigma: float
    lsb: float
    source: str
    rng: Generator


@dataclass(frozen=True, slots=True)
class Conditions:
    """Time, temperature and other axes at the samples on which an effect acts.

    Attributes
    ----------
    first : int
        Number of its first sample since the start of the record.
    time_s : ndarray of float64, shape (n,)
        True time of each sample since the start of the record.
    temperature_c : ndarray of float64, shape (n,)
        True temperature of the sensor at each sample, less 25 degC.
    axes : mapping
        Signals of all axes, each shape (n,); empty before the stage ``coupling``.
    """

    first: int
    time_s: NDArray[np.float64]
    temperature_c: NDArray[np.float64]
    axes: Mapping[str, NDArray[np.float64]]

    def after(self, rows: int) -> Conditions:
        """Return the conditions without those of the first `rows` samples."""
        return Conditions(
            self.first + rows,
            self.time_s[rows:],
            self.temperature_c[rows:],
            {axis: signal[rows:] for axis, signal in self.axes.items()},
        )


Apply = Callable[[NDArray[Any], Conditions], None]
"""Alters samples in place; called with consecutive stretches of samples."""

SetUp = Callable[[Mapping[str, float], EffectContext], Apply]
"""Prepares an effect for one axis, with its parameters by name."""


@dataclass(frozen=True, slots=True)
class EffectKind:
    """One kind of effect, made by the decorator `effect` in one of the modules of this package.

    The modules are read whenever the words of the command line are, so heavy imports belong into
    `set_up`.

    Attributes
    ----------
    name : str
        Word of the fixed vocabulary, as in the result.
    summary : str
        One line for the help.
    stage : str
        Where in the chain it acts.
    parameters : mapping
        Its numbers, in the names and units of the vocabulary.
    set_up : SetUp
        States its equation.
    takes_source : bool
        Whether it needs another axis, named ``source``.
    """

    name: str
    summary: str
    stage: Stage
    parameters: Mapping[str, Parameter]
    set_up: SetUp
    takes_source: bool = False


def effect(
    name: str, summary: str, stage: Stage, *, takes_source: bool = False, **parameters: Parameter
) -> Callable[[SetUp], EffectKind]:
    """Make the decorated `SetUp` a kind of effect; see `EffectKind`."""
    return lambda set_up: EffectKind(name, summary, stage, parameters, set_up, takes_source)


@cache
def effect_kinds() -> Mapping[str, EffectKind]:
    """Return all kinds of effects by name.

    Examples
    --------
    >>> effect_kinds()["step"].summary
    'a change of the level at one time'
    """
    modules = (import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__))
    values = (value for module in modules for value in vars(module).values())
    kinds = (value for value in values if isinstance(value, EffectKind))
    return {kind.name: kind for kind in sorted(kinds, key=lambda kind: kind.name)}
