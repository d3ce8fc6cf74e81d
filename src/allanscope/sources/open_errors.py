"""Why a port cannot be opened, in one line that says what to do about it."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from allanscope.errors import DeviceError
from allanscope.sources.discovery import PortDescription, plugged_in

__all__ = ["why_not_open"]

_MISSING = {errno.ENOENT, errno.ENODEV, errno.ENXIO}
_DENIED = {errno.EACCES, errno.EPERM}
_BUSY = {errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK}
_NO_TTY = {errno.ENOTTY, errno.EINVAL, errno.EISDIR}


def why_not_open(name: str, error: Exception, ports: list[PortDescription]) -> DeviceError:
    """Return the error to raise when `name` could not be opened.

    Parameters
    ----------
    name : str
        Path or URL.
    error : Exception
        What the system or pyserial said.
    ports : list of PortDescription
        What is plugged in.
    """
    reason = _reason(error)
    if "://" in name:
        return DeviceError(f"cannot open {name}: {_words(error)}; is the other side running?")
    if reason in _MISSING:
        return DeviceError(
            f"there is no port {name}: {plugged_in(ports)}; "
            "see `allanscope ports`, or try: allanscope live sim"
        )
    if reason in _DENIED:
        return DeviceError(f"no permission to open {name}: {_permission_advice(name)}")
    if reason in _BUSY:
        return DeviceError(f"{name} is in use by {_holders(name)}")
    if reason in _NO_TTY:
        return DeviceError(f"{name} is no serial port; see `allanscope ports`")
    return DeviceError(f"cannot open {name}: {_words(error)}")


def _reason(error: Exception) -> int | None:
    """Return the errno behind an error; pyserial leaves it out, or tells it in words."""
    number = getattr(error, "errno", None)
    if number is None and error.args and isinstance(error.args[0], int):
        number = error.args[0]  # termios.error
    if number is not None:
        return int(number)
    text = str(error)
    for words, meaning in (
        ("FileNotFoundError", errno.ENOENT),  # Windows
        ("PermissionError", errno.EBUSY),  # Windows says so when another program has it
        ("Inappropriate ioctl", errno.ENOTTY),
        ("Could not configure port", errno.ENOTTY),
    ):
        if words in text:
            return meaning
    return None


def _words(error: Exception) -> str:
    """Return what went wrong, on one line."""
    strerror = getattr(error, "strerror", None)
    return " ".join(str(strerror or error).split())


def _permission_advice(name: str) -> str:
    group = "dialout"
    try:
        import grp

        group = grp.getgrgid(os.stat(name).st_gid).gr_name
    except (ImportError, KeyError, OSError):
        pass
    if group == "root":
        return "add a udev rule that gives it to a group of yours"
    return f"run `sudo usermod -aG {group} $USER` and log in again, or add a udev rule"


def _holders(name: str) -> str:
    """Return which programs have a file open, as far as the system lets us see, and what to do."""
    target = os.path.realpath(name)
    found = set()
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        try:
            if os.path.realpath(link) == target:
                process = link.parent.parent
                name = (process / "comm").read_text("utf-8", "replace").strip()
                found.add(f"{name} (pid {process.name})")
        except OSError:
            continue
    if found:
        return f"{', '.join(sorted(found))}; end that and try again"
    return (
        "another program; ModemManager does so for some seconds after plugging in: try again, "
        "or look with `lsof`"
    )
