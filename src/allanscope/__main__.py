"""The command line's entry: run a command, turn errors into one line and an exit code."""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress

from allanscope.cli import WITH_SETTINGS, keep_inputs, parser
from allanscope.errors import AllanscopeError, ExitCode, UsageError
from allanscope.lazy import defer_unused
from allanscope.sanitize import print_error, spell_out_standard_streams

__all__ = ["main"]

_DISTRIBUTION = {"PIL": "pillow", "rerun": "rerun-sdk", "serial": "pyserial", "yaml": "pyyaml"}
"""Names of modules that differ from those of the packages which bring them."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    spell_out_standard_streams()
    # Before numpy is loaded. Matrices are small here: threads of BLAS wait for each other longer
    # than they compute, and the last digits would depend on the number of cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    words = sys.argv[1:] if argv is None else argv
    if "" in words:
        # As a path it would stand for the present folder.
        parser().error("an argument is empty (a shell variable that is not set?)")
    top = parser()
    try:
        if words and words[0] in WITH_SETTINGS:
            from allanscope.shell import apply_settings

            apply_settings(top)
        arguments = top.parse_args(words)
        if argv is None and not (arguments.debug or sys.warnoptions):
            # numpy's remarks on a division by zero are for those who read the sources.
            warnings.filterwarnings("ignore", category=RuntimeWarning)
    except (UsageError, BrokenPipeError) as error:
        return _not_parsed(error)
    try:
        with _searches_shown() if arguments.debug else nullcontext():
            keep_inputs(arguments)
            defer_unused()
            code = int(arguments.command(arguments))
            if sys.stdout is not None:
                sys.stdout.flush()  # a full disk behind it is told now, and not after the end
            return code
    except AllanscopeError as error:
        if arguments.debug:
            import traceback  # loaded only where it is shown

            traceback.print_exc()
        else:
            print_error(error)
        return int(error.exit_code)
    except KeyboardInterrupt:
        # A session ends in order and does not come here; whatever else was stopped is not done.
        print_error("stopped before it was done")
        return ExitCode.STOPPED
    except BrokenPipeError:
        # The reader of our output (head, less) has gone: nothing is left to say to it.
        _discard_unwritable_output()
        return ExitCode.DONE
    except Exception as error:
        _discard_unwritable_output()
        if arguments.debug:
            raise
        return _unexpected(error, words[0])


def _not_parsed(error: UsageError | BrokenPipeError) -> int:
    if isinstance(error, UsageError):
        print_error(error)
        return int(error.exit_code)
    _discard_unwritable_output()  # what was asked for, such as --version, had no reader any more
    return ExitCode.DONE


def _unexpected(error: Exception, command: str) -> int:
    """Print an internal error, or which package is not installed; return the exit code."""
    if isinstance(error, ModuleNotFoundError):
        missing = _missing_package(error, command)
        if missing is not None:
            print_error(missing)
            return ExitCode.USAGE
    what = f"{type(error).__name__}: {error}"
    print_error(f"internal error: {what}; run with --debug for the traceback")
    return ExitCode.UNEXPECTED


def _missing_package(error: ModuleNotFoundError, command: str) -> str | None:
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
    >>> print(_missing_package(error, "fleet"))
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
    from importlib.metadata import PackageNotFoundError, requires  # needed only here

    try:
        lines = requires("allanscope") or []
    except PackageNotFoundError:  # run from its sources
        lines = []
    names = (line.partition(";")[0].strip() for line in lines)
    return next((one for one in names if re.split(r"[<>=!~\[ ]", one)[0] == package), package)


def _discard_unwritable_output() -> None:
    """Let what standard output does not take go nowhere: Python would try again at its end."""
    try:
        sys.stdout.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def _searches_shown() -> Iterator[None]:
    """Print what each search for effects tries, and which gate stopped it."""
    import logging  # loaded only where it is shown

    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(message)s"))
    logger = logging.getLogger("allanscope.explain.search")
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


if __name__ == "__main__":
    sys.exit(main())
