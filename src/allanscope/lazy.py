"""What is made when it is first asked for: names of a package, and properties of an instance.

Numerical code is not light to load, and reading a result needs none of
it. So a package says in which of its modules a name lives, and whoever uses the name pays for it::

    if TYPE_CHECKING:
        from allanscope.spectrum import SpectrumBank

    __all__ = ["SpectrumBank"]

    __getattr__, __dir__ = lazily(__name__, {"SpectrumBank": "bank"})

Type checkers and editors read the imports that are never run; the mapping names the same modules.

A property that takes long to compute is `once`. `functools.cached_property` of Python 3.11 holds
one lock for all instances of a class while it computes: the transforms of two axes, each in its own
thread, would wait for each other. Here nothing is locked; two threads that ask the same instance at
once both compute the same.

Other people's packages load what they do not use. SciPy takes every name of numpy, and so loads a
front end for Fortran compilers, a framework for tests, masked arrays, and what those import: half
of the time that `scipy.special` takes, and memory. Its package of optimisers loads all of them,
sparse matrices and rotations for the one that is wanted; Rerun loads readers of other files.
`defer_unused` leaves these unloaded until somebody uses them.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.abc import Loader
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from types import ModuleType
from typing import Any, Generic, TypeVar, overload

__all__ = ["defer_unused", "lazily", "once"]

_UNUSED = frozenset(
    {
        *("numpy.f2py", "numpy.ma", "numpy.testing"),
        *("rerun.experimental", "rerun.server", "rerun.urdf"),
        "scipy.optimize",
    }
)

_Owner = TypeVar("_Owner")
_Value = TypeVar("_Value")


def lazily(
    package: str, homes: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the ``__getattr__`` and the ``__dir__`` of a package (PEP 562).

    Parameters
    ----------
    package : str
        Name of the package.
    homes : mapping
        For each name the module within the package that defines it. A name must not be that of a
        module of the package: Python puts a module there under its own name as soon as it is
        imported.

    Examples
    --------
    >>> find, _ = lazily("allanscope", {"AXES": "samples"})
    >>> find("AXES")
    ('gx', 'gy', 'gz', 'ax', 'ay', 'az')
    >>> find("axes")
    Traceback (most recent call last):
        ...
    AttributeError: module 'allanscope' has no attribute 'axes'
    """

    def find(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{homes[name]}"), name)

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *homes})

    return find, names


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


def defer_unused() -> None:
    """Keep other packages from loading modules that are never used.

    For a process of our own: to a program that imports allanscope nothing is done.
    """
    if "scipy" not in sys.modules:
        sys.meta_path.insert(0, _Finder())


class _Finder:
    """Finds modules that load themselves when one of their names is asked for.

    Modules of a package that is found so can be loaded without it.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in _UNUSED:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = _Deferred(spec.loader)
        return spec


class _Deferred(Loader):
    """Loads a module when a name is asked for that it does not have yet.

    `importlib.util.LazyLoader` of Python 3.11 lets a second thread see a module half loaded.

    Parameters
    ----------
    loader : Loader
        Who loads it.
    """

    def __init__(self, loader: Loader) -> None:
        self._loader = loader
        self._loading = threading.RLock()
        self._begun = False

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        """Return what the loader makes."""
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        """Do nothing yet."""

        def find(name: str) -> Any:
            inner = f"{module.__name__}.{name}"
            if not self._begun and "__path__" in vars(module) and find_spec(inner) is not None:
                return import_module(inner)  # `from package import module` needs no more of it
            with self._loading:
                if not self._begun:
                    self._begun = True
                    self._loader.exec_module(module)
            try:
                return vars(module)[name]
            except KeyError:
                text = f"module {module.__name__!r} has no attribute {name!r}"
                raise AttributeError(text) from None

        vars(module)["__getattr__"] = find
