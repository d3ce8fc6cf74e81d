"""One effect that a simulated sensor is to have, and how it is written on the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from allanscope.errors import UsageError
from allanscope.samples import AXES
from allanscope.simulator.effects import EffectKind, effect_kinds
from allanscope.simulator.parameters import Parameter, check_names, number, split_spec

__all__ = ["EffectSpec", "effect_help", "parse_effect"]

GROUPS: Mapping[str, tuple[str, ...]] = {
    "all": AXES,
    "gyro": AXES[:3],
    "accel": AXES[3:],
}
DEFAULT_AXIS = "gx"
TIME = Parameter("s", "from the start of the record, from which the effect acts", 0.0, least=0.0)


@dataclass(frozen=True, slots=True)
class EffectSpec:
    """An effect with its numbers.

    Attributes
    ----------
    kind : str
        Word of the vocabulary, e.g. ``sinusoid``.
    parameters : mapping
        Numbers of the effect, defaults filled in.
    axes : tuple of str
        Axes that have it; empty for an effect of the device as a whole (``clock_error``).
    time : float
        Seconds from the start of the record from which it acts.
    source : str
        The other axis, where the effect needs one.

    Raises
    ------
    UsageError
        For a kind, a parameter or an axis that does not exist, or a number out of range.
    """

    kind: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    axes: tuple[str, ...] = (DEFAULT_AXIS,)
    time: float = 0.0
    source: str = ""

    def __post_init__(self) -> None:
        kinds = effect_kinds()
        if self.kind not in kinds:
            split_spec(self.kind, "effect", kinds)  # raises, listing them
        kind, where = kinds[self.kind], f"effect {self.kind}"
        check_names(where, self.parameters, _names(kind))
        if kind.takes_source and not self.source:
            raise UsageError(f"{where}: source is missing; it takes {', '.join(_names(kind))}")
        for axis in self.axes + ((self.source,) if kind.takes_source else ()):
            if axis not in AXES:
                raise UsageError(f"{where}: unknown axis {axis!r}; axes are {' '.join(AXES)}")
        values = {
            name: number(where, name, _given(where, kind, name, self.parameters), limits)
            for name, limits in kind.parameters.items()
        }
        object.__setattr__(self, "parameters", values)
        object.__setattr__(self, "time", number(where, "time", self.time, TIME))
        if kind.stage == "clock":
            object.__setattr__(self, "axes", ())

    @classmethod
    def from_result(cls, axis: str, effect: Mapping[str, Any]) -> EffectSpec:
        """Return an effect of one axis as the JSON result describes it.

        Numbers that the simulator has no use for are left out; the others may be plain or
        ``{"value": ...}``.

        Raises
        ------
        UsageError
            For a kind that cannot be simulated.

        Examples
        --------
        >>> numbers = {"time": {"value": 60.0}, "size": {"value": 0.1}}
        >>> EffectSpec.from_result("gy", {"kind": "step", "parameters": numbers}).time
        60.0
        """
        kind = effect_kinds().get(str(effect.get("kind")))
        if kind is None:
            raise UsageError(f"cannot simulate the effect {effect.get('kind')!r}")
        plain: dict[str, Any] = {
            name: value.get("value") if isinstance(value, Mapping) else value
            for name, value in effect.get("parameters", {}).items()
        }
        return cls(
            kind=kind.name,
            parameters={name: plain[name] for name in kind.parameters if name in plain},
            axes=tuple(effect.get("axes") or (axis,)) if kind.stage == "rows" else (axis,),
            time=plain.get("time") or 0.0,
            source=str(plain.get("source", "")) if kind.takes_source else "",
        )


def parse_effect(text: str) -> EffectSpec:
    """Return the effect that ``KIND:param=value,...`` describes.

    Every effect also takes ``axis`` (an axis, ``gyro``, ``accel`` or ``all``; default gx, and all
    for repeated_samples) and ``time``, the seconds from which it acts.

    Raises
    ------
    UsageError
        One line that lists what exists.

    Examples
    --------
    >>> parse_effect("sinusoid:frequency=5,amplitude=0.01,axis=gz")
    EffectSpec(kind='sinusoid', parameters={'frequency': 5.0, 'amplitude': 0.01, 'locked': 0.0},
               axes=('gz',), time=0.0, source='')
    >>> parse_effect("sinusoid:frequency=5")
    Traceback (most recent call last):
    allanscope.errors.UsageError: effect sinusoid: amplitude is missing; it takes frequency,
        amplitude, locked, axis, time
    """
    name, raw = split_spec(text, "effect", effect_kinds())
    kind, where = effect_kinds()[name], f"effect {name}"
    check_names(where, raw, _names(kind))
    return EffectSpec(
        kind=name,
        parameters={
            given: number(where, given, value, kind.parameters[given])
            for given, value in raw.items()
            if given in kind.parameters
        },
        axes=_axes(where, kind, raw.get("axis")),
        time=number(where, "time", raw.get("time", 0.0), TIME),
        source=raw.get("source", ""),
    )


def effect_help() -> str:
    """Return one line for each kind of effect, for the help of the command line."""
    return "\n".join(
        f"{kind.name}: {kind.summary} ({', '.join(_names(kind))})"
        for kind in effect_kinds().values()
    )


def _names(kind: EffectKind) -> dict[str, object]:
    """Return everything that may be written after the colon, in the order of the help."""
    own: dict[str, object] = dict(kind.parameters)
    if kind.takes_source:
        own = {"source": None, **own}
    return own if kind.stage == "clock" else {**own, "axis": None, "time": None}


def _given(where: str, kind: EffectKind, name: str, given: Mapping[str, float]) -> float:
    value = given.get(name, kind.parameters[name].default)
    if value is None:
        raise UsageError(f"{where}: {name} is missing; it takes {', '.join(_names(kind))}")
    return value


def _axes(where: str, kind: EffectKind, name: str | None) -> tuple[str, ...]:
    if name is None:
        name = "all" if kind.stage == "rows" else DEFAULT_AXIS
    if name not in GROUPS and name not in AXES:
        known = " ".join((*AXES, *GROUPS))
        raise UsageError(f"{where}: unknown axis {name!r}; axes are {known}")
    return GROUPS.get(name, (name,))
