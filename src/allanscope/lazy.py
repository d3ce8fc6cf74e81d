"""Names that a package offers and imports when they are first asked for.

Numerical code with its compiled kernels is not light to load, and reading a result needs none of
it. So a package says in which of its modules a name lives, and whoever uses the name pays for it::

    if TYPE_CHECKING:
        from allanscope.spectrum import SpectrumBank

    __all__ = ["SpectrumBank"]

    __getattr__, __dir__ = lazily(__name__, {"SpectrumBank": "bank"})

Type checkers and editors read the imports that are never run; the mapping names the same modules.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

__all__ = ["lazily"]


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
