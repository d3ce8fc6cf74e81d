"""What to say where a package that a command needs is not installed."""

from __future__ import annotations

import re
import sys
from importlib.metadata import PackageNotFoundError, requires

__all__ = ["missing_package_message"]

_DISTRIBUTION = {"PIL": "pillow", "rerun": "rerun-sdk", "serial": "pyserial", "yaml": "pyyaml"}
"""Names of modules that differ from those of the packages which bring them."""


def missing_package_message(error: ModuleNotFoundError, command: str) -> str | None:
    """Return a line for a package that is not installed, None for a module of our own.

    Parameters
    ----------
    error : ModuleNotFoundError
        Raised by the import.
    command : str
        Of allanscope, that ran into it.

    Examples
    --------
    >>> error = ModuleNotFoundError("No module named 'zarr'", name="zarr")
    >>> print(missing_package_message(error, "fleet"))
    fleet needs the package zarr, which is not installed: python -m pip install zarr
    """
    module = (error.name or "").partition(".")[0]
    if module in ("", "allanscope") or module in sys.modules:
        return None  # a part of a package that is there: its version is wrong, or it is damaged
    package = _DISTRIBUTION.get(module, module)
    wanted = _requirement(package)
    quoted = f"'{wanted}'" if set(wanted) & set("<>~! ") else wanted
    return (
        f"{command} needs the package {package}, which is not installed: "
        f"python -m pip install {quoted}"
    )


def _requirement(package: str) -> str:
    """Return a package with the versions that are asked for, as far as they are known."""
    try:
        lines = requires("allanscope") or []
    except PackageNotFoundError:  # run from its sources
        lines = []
    names = (line.partition(";")[0].strip() for line in lines)
    return next((one for one in names if re.split(r"[<>=!~\[ ]", one)[0] == package), package)
