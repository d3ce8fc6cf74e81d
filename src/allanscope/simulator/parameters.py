"""The grammar of ``--effect`` and ``--fault``: ``KIND:param=value,param=value``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from allanscope.errors import UsageError

__all__ = ["Parameter", "check_names", "number", "split_spec"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number that an effect or a fault takes.

    Attributes
    ----------
    unit : str
        Its unit; ``"axis"`` for the amplitudes whose unit is that of the axis.
    meaning : str
        One line.
    default : float or None
        None when it must be given.
    above, least : float
        Lower limit, exclusive and inclusive.
    most : float
        Upper limit, inclusive.
    """

    unit: str
    meaning: str
    default: float | None = None
    above: float = -math.inf
    least: float = -math.inf
    most: float = math.inf


def split_spec(text: str, what: str, kinds: Iterable[str]) -> tuple[str, dict[str, str]]:
    """Return the kind and the raw parameters of ``KIND:param=value,...``.

    Raises
    ------
    UsageError
        If the kind is none of `kinds`, or a parameter is not of the form ``name=value``.

    Examples
    --------
    >>> split_spec("step:time=60,size=0.1", "effect", ["step"])
    ('step', {'time': '60', 'size': '0.1'})
    """
    kind, _, rest = text.strip().partition(":")
    if kind not in kinds:
        raise UsageError(f"unknown {what} {kind!r}; choose one of {', '.join(kinds)}")
    parameters: dict[str, str] = {}
    for item in filter(None, (part.strip() for part in rest.split(","))):
        name, equals, value = item.partition("=")
        if not equals or not value:
            raise UsageError(f"{what} {text!r}: {item!r} is not of the form name=value")
        parameters[name.strip()] = value.strip()
    return kind, parameters


def number(where: str, name: str, value: object, limits: Parameter) -> float:
    """Return a parameter as a float within its limits.

    Raises
    ------
    UsageError
        If it is no finite number or out of its limits; the message starts with `where`.

    Examples
    --------
    >>> number("effect step", "size", "0.1", Parameter("axis", "size of the step"))
    0.1
    """
    try:
        result = float(value)  # type: ignore[arg-type]  # anything else is a TypeError
    except (TypeError, ValueError, OverflowError):
        result = math.nan
    if not math.isfinite(result):
        raise UsageError(f"{where}: {name} must be a number, got {value!r}")
    if not (limits.above < result and limits.least <= result <= limits.most):
        bounds = {"above": limits.above, "at least": limits.least, "at most": limits.most}
        words = (f"{word} {bound:g}" for word, bound in bounds.items() if math.isfinite(bound))
        raise UsageError(f"{where}: {name} must be {' and '.join(words)}, got {result:g}")
    return result


def check_names(where: str, given: Iterable[str], known: Mapping[str, object]) -> None:
    """Raise UsageError for a parameter that does not exist; the message lists those that do."""
    for name in given:
        if name not in known:
            raise UsageError(f"{where}: no parameter {name!r}; it takes {', '.join(known)}")
