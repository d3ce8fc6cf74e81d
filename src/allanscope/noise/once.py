"""A property that is computed when it is first asked for, and kept.

`functools.cached_property` of Python 3.11 holds one lock for all instances of a class while it
computes: the transforms of two axes, each in its own thread, would wait for each other. Here
nothing is locked; two threads that ask the same instance at once both compute the same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar, overload

__all__ = ["once"]

_Owner = TypeVar("_Owner")
_Value = TypeVar("_Value")


class once(Generic[_Owner, _Value]):  # noqa: N801 - reads as `property` does
    """Decorate a method without arguments.

    Examples
    --------
    >>> class Record:
    ...     @once
    ...     def mean(self) -> float:
    ...         print("computed")
    ...         return 0.5
    >>> record = Record()
    >>> record.mean + record.mean
    computed
    1.0
    """

    def __init__(self, compute: Callable[[_Owner], _Value]) -> None:
        self._compute = compute
        self._name = compute.__name__
        self.__doc__ = compute.__doc__

    @overload
    def __get__(self, owner: None, kind: type[Any]) -> once[_Owner, _Value]: ...

    @overload
    def __get__(self, owner: _Owner, kind: type[Any]) -> _Value: ...

    def __get__(self, owner: _Owner | None, kind: type[Any]) -> once[_Owner, _Value] | _Value:
        """Compute the value and put it in the property's place in the instance."""
        if owner is None:
            return self
        value = self._compute(owner)
        owner.__dict__[self._name] = value
        return value
