"""The loops through which every sample goes, in C, compiled before they were installed.

========================  ==========================================================
`Pointer`, `kernel`       how a module calls a loop: checked arrays in, no copies
`Fixed`                   arrays that a loop gets again and again, checked once
`build`                   compiles the sources beside it; not part of a wheel
``*.c``                   the loops, a subject a file; `library.c` is all of them
========================  ==========================================================

Nothing compiles on the machine of a user, and one library serves all versions of Python: it knows
neither Python nor numpy. It holds every loop once for each level of the processor (`processor.c`),
and the highest that runs here is taken. A call through `ctypes` releases the interpreter's lock.
All arrays are checked here and nowhere else: a loop does not check its arguments.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from allanscope.errors import AllanscopeError

__all__ = ["Fixed", "LibraryMissing", "Pointer", "kernel"]

_HERE = Path(__file__).parent
_SUFFIX = {"win32": "dll", "darwin": "dylib"}.get(sys.platform, "so")


class LibraryMissing(AllanscopeError, ImportError):
    """The compiled loops are not there, or are not those of the sources beside them.

    Parameters
    ----------
    problem : str
        What is wrong.
    remedy : str
        The command that builds or installs the library.
    """

    def __init__(self, problem: str, remedy: str) -> None:
        super().__init__(f"{problem}; run: {remedy}")
        self.problem = problem
        self.remedy = remedy


class Pointer:
    """An argument of a loop: a contiguous array of one type and number of dimensions.

    `numpy.ctypeslib.ndpointer` checks as much in four times the time.

    Parameters
    ----------
    dtype : dtype
        Type of the elements, in native byte order.
    ndim : int
        Number of dimensions.
    written : bool
        Whether the loop writes to the array.

    Examples
    --------
    >>> Pointer(np.float64, 2).from_param(np.zeros(3))
    Traceback (most recent call last):
    ...
    TypeError: a loop takes contiguous float64 of 2 dimensions, got float64 of shape (3,)
    """

    def __init__(self, dtype: DTypeLike, ndim: int, *, written: bool = False) -> None:
        self.dtype = np.dtype(dtype)
        self.ndim = ndim
        self.written = written

    def from_param(self, array: NDArray[Any]) -> Any:
        """Return the address of an array as a call takes it; TypeError where it does not fit."""
        flags = array.flags
        if (
            array.dtype != self.dtype
            or array.ndim != self.ndim
            or not flags.c_contiguous
            or (self.written and not flags.writeable)
        ):
            what = "writeable, contiguous" if self.written else "contiguous"
            raise TypeError(
                f"a loop takes {what} {self.dtype} of {self.ndim} dimensions, "
                f"got {array.dtype} of shape {array.shape}"
            )
        if flags.writeable and array.size:
            return ctypes.byref(_first_byte(array))  # in a quarter of the time of what follows
        return ctypes.c_void_p(array.ctypes.data)


_first_byte: Callable[[Any], ctypes.c_char] = ctypes.c_char.from_buffer


class Fixed:
    """Arrays that are the last arguments of each call of a loop: to check them takes 2 us each.

    A copy of their owner has a copy of this, which finds the copied arrays.

    Parameters
    ----------
    arrays : ndarray
        They must stay where they are, and be written to in place.
    """

    def __init__(self, *arrays: NDArray[Any]) -> None:
        self._arrays = arrays
        self._bound: Callable[..., Any] | None = None
        self._addresses: list[int] = []

    def call(self, loop: Any, *others: Any) -> Any:
        """Call a loop, always the same one, with other arguments and these arrays."""
        if self._bound is None:
            own, checked = loop.argtypes[: len(others)], loop.argtypes[len(others) :]
            for kind, array in zip(checked, self._arrays, strict=True):
                kind.from_param(array)
            self._addresses = [array.ctypes.data for array in self._arrays]
            self._bound = bound = _library()[0][loop.__name__]
            bound.argtypes = [*own, *(ctypes.c_void_p for _ in checked)]
            bound.restype = loop.restype
        return self._bound(*others, *self._addresses)

    def __getstate__(self) -> tuple[NDArray[Any], ...]:
        return self._arrays

    def __setstate__(self, arrays: tuple[NDArray[Any], ...]) -> None:
        self.__init__(*arrays)  # type: ignore[misc]


def kernel(name: str, *arguments: Any, returns: Any = None) -> Callable[..., Any]:
    """Return a loop of the library.

    Parameters
    ----------
    name : str
        Its name in the sources.
    arguments : Pointer or ctypes type
        What it takes; ``int`` and ``float`` stand for 64 bits.
    returns : type, optional
        ``int``, ``float``, or nothing.

    Raises
    ------
    LibraryMissing
        With the command that builds it.
    """
    library, level = _library()
    found = getattr(library, f"{name}_v{level}")
    found.argtypes = [_TYPES.get(argument, argument) for argument in arguments]
    found.restype = _TYPES.get(returns, returns)
    return found  # type: ignore[no-any-return]


_TYPES: dict[Any, Any] = {int: ctypes.c_int64, float: ctypes.c_double}


@cache
def _library() -> tuple[ctypes.CDLL, int]:
    """Load the library; return it and the level of the processor."""
    path = _HERE / f"library.{_SUFFIX}"
    builder = _HERE / "build.py"
    remedy = f"python {builder}" if builder.exists() else "pip install --force-reinstall allanscope"
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise LibraryMissing(f"the compiled loops cannot be loaded ({error})", remedy) from None
    if builder.exists():
        from allanscope.compiled.build import fingerprint

        library.sources.restype = ctypes.c_char_p
        if library.sources().decode() != fingerprint():
            raise LibraryMissing(f"{path} was compiled from other sources", remedy)
    return library, library.processor_level()
