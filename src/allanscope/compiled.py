"""Numba's compiler, with a folder for compiled code wherever the program runs.

Numba keeps compiled code beside the source or in the home folder of the user, and refuses to
compile when it can write to neither, as in many containers and system services. A temporary folder
then takes their place: the program works there too, and starts fast from the second time on.
"""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numba.core.config

__all__ = ["njit"]

_CONFIG: Any = numba.core.config


def njit(*signatures: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile as `numba.njit` does, and keep what was compiled in a folder that can be written to.

    Examples
    --------
    >>> @njit(nogil=True)
    ... def double(x):
    ...     return 2 * x
    >>> double(3)
    6
    """
    compile_it = numba.njit(*signatures, **options)

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            return compile_it(function)
        except RuntimeError as error:
            if "cannot cache" not in str(error):
                raise
        _use_temporary_folder()
        return compile_it(function)

    return compiled


@cache
def _use_temporary_folder() -> None:
    """Let numba keep its code in a temporary folder, in this process and in its children.

    Matplotlib keeps its list of fonts there as well, or it would make one at every start.
    """
    folder = str(_private_folder())
    _CONFIG.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"] = folder
    os.environ.setdefault("MPLCONFIGDIR", os.path.join(folder, "matplotlib"))
    print(
        f"allanscope: compiled code is kept in {folder}, because neither the package nor a home "
        "folder can be written to; NUMBA_CACHE_DIR can name another folder",
        file=sys.stderr,
        flush=True,
    )


def _private_folder() -> Path:
    """Return the folder of this user for the next start to find, or a new one where it is not safe.

    Compiled code is executed, so no other user may have made the folder or may write to it.
    """
    user = os.getuid() if hasattr(os, "getuid") else "user"
    folder = Path(tempfile.gettempdir()) / f"allanscope-compiled-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        private = stat.S_ISDIR(found.st_mode) and not found.st_mode & 0o022
        if (private and found.st_uid == user) or sys.platform == "win32":
            tempfile.TemporaryFile(dir=folder).close()
            return folder
    except OSError:
        pass  # a file of that name, or a folder of somebody else
    return Path(tempfile.mkdtemp(prefix="allanscope-compiled-"))


if os.path.expanduser("~") == "~" and not os.access(Path(__file__).parent, os.W_OK):
    # A user without a home: numba would make a folder named "~" where the program was started.
    _use_temporary_folder()
