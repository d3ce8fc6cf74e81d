"""Errors that end a command, and the exit code each one has.

Every error carries one line that says what happened, where, and what to do about it; the command
line prints that line and nothing else unless ``--debug`` is given.
"""

from __future__ import annotations

from enum import IntEnum

__all__ = [
    "AllanscopeError",
    "CheckFailed",
    "DeviceError",
    "ExitCode",
    "InputError",
    "UsageError",
]


class ExitCode(IntEnum):
    """What the exit status of a command means."""

    DONE = 0
    UNEXPECTED = 1
    USAGE = 2
    INPUT = 3
    DEVICE = 4
    CHECK_FAILED = 5
    INCOMPLETE = 6
    STOPPED = 130


class AllanscopeError(Exception):
    """Base of all errors that are reported in one line."""

    exit_code: ExitCode = ExitCode.USAGE


class UsageError(AllanscopeError, ValueError):
    """The call asks for something that does not exist, e.g. an unknown part name.

    In Python it is a ValueError like any other argument that is not possible.
    """

    exit_code = ExitCode.USAGE


class InputError(AllanscopeError):
    """A file or a byte stream cannot be read, e.g. a picture given as a recording."""

    exit_code = ExitCode.INPUT


class DeviceError(AllanscopeError):
    """A device was lost or never found, e.g. a port that does not exist or is busy."""

    exit_code = ExitCode.DEVICE


class CheckFailed(AllanscopeError):
    """A coefficient misses the limit that a specification sets."""

    exit_code = ExitCode.CHECK_FAILED
