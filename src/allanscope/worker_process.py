"""Another interpreter that computes beside this one.

Python computes on one core, however many threads it has, and a thread that computes keeps those
that read a port waiting. What takes seconds is therefore given to another process, which takes
functions and their arguments from a pipe and gives back what they return. The standard library's
pools run the user's script once more in each process, which most scripts are not written for; this
one runs only what it is given.

Some arguments are large and wanted again, or are what a result refers to. These are shared on both
sides, and are named in the pipe instead of copied::

    with WorkerProcess("allanscope.explain.loop") as worker:
        worker.share(record)
        worker.call(searched, record, "gx")  # `record` is a few bytes here

Arrays are not copied into the pipe's format: they follow it as they are, when there is room in the
pipe, while whoever shares them goes on.

The process ends with its pipe, so none is left behind by a program that was killed.
"""

from __future__ import annotations

import gc
import os
import pickle
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from importlib import import_module
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, ParamSpec, Self, TypeVar

from allanscope.lazy import defer_unused

__all__ = ["KEPT_BYTES", "REUSED_BYTES", "SEARCH", "WorkerError", "WorkerProcess", "place_of"]

SEARCH = "allanscope.analysis.summary allanscope.explain.loop"
"""Modules that a process which searches for effects loads before it is asked."""

REUSED_BYTES, KEPT_BYTES = 1 << 26, 1 << 27
"""The largest block that is kept for the next one of its size, and what is kept of free ones."""
_ENVIRONMENT = {
    "MALLOC_ARENA_MAX": "1",
    "MALLOC_MMAP_THRESHOLD_": str(REUSED_BYTES),
    "MALLOC_TRIM_THRESHOLD_": str(KEPT_BYTES),
    "OPENBLAS_NUM_THREADS": "1",
}
"""It computes with arrays as long as a record, one after the other, and ends: the usual C library
of Linux is told to keep what was freed for the next one. There is a process for every core: threads
of BLAS would take them from each other."""

_LAST_WORDS_S = 1.0
"""In which a process that breaks off has ended, and said why."""

P = ParamSpec("P")
T = TypeVar("T")


class WorkerError(RuntimeError):
    """The process could not be started, or ended without an answer."""


class WorkerProcess:
    """A process that computes what it is asked for; one question at a time.

    Parameters
    ----------
    preload : str
        Modules that it loads at once, before it is asked; spaces between them.
    nice : int
        By how much its priority is lowered, where there are priorities.

    Notes
    -----
    What fails to start says so at the first question.
    """

    def __init__(self, preload: str = "", nice: int = 0) -> None:
        self._shared: list[object] = []
        self._calling, self._sending = threading.Lock(), threading.Lock()
        self._writer = ThreadPoolExecutor(1)
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115 closed with the process
        command = [sys.executable, "-P", "-m", __name__, preload, str(nice)]
        modules = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}  # the same as here
        self._process: subprocess.Popen[bytes] | None = None
        self._why_not = ""
        try:
            # A session of its own: Ctrl-C in the terminal is for us to understand.
            self._process = subprocess.Popen(
                command,
                env={**_ENVIRONMENT, **os.environ, **modules},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._stderr,
                start_new_session=True,
            )
        except OSError as error:
            self._why_not = f"{type(error).__name__}: {error}"

    def share(self, *objects: object) -> None:
        """Share objects with the process until the end: they must not change any more.

        It takes them when it has answered what it was asked before; nobody waits for that here.
        That it has ended says the next call.
        """
        with self._sending, suppress(WorkerError):
            self._send(None, objects)
            self._shared += objects

    def call(self, function: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T:
        """Return what a function of a module returns there; raise what it raises.

        A call from another thread waits for its turn.

        Raises
        ------
        WorkerError
            When the process has ended.
        """
        with self._calling:
            self.ask(function, *arguments, **named)
            return self.answer()  # type: ignore[no-any-return]

    def ask(self, function: Callable[P, object], *arguments: P.args, **named: P.kwargs) -> None:
        """Begin a call, whose `answer` is to be taken before the next one.

        Raises
        ------
        WorkerError
            When the process has ended.
        """
        try:
            with self._sending:
                sent = self._send(function, arguments, named)
            sent.result()
        except (OSError, ValueError) as broken:  # ended, or closed from another thread
            raise self._ended(broken) from None

    def answer(self) -> Any:
        """Wait for the call that was begun; return what it returns, raise what it raises.

        Raises
        ------
        WorkerError
            When the process has ended.
        """
        if self._process is None:
            raise WorkerError(self._why_not)
        assert self._process.stdout is not None
        try:
            error, answer = _load(self._process.stdout, self._shared)
        except Exception as broken:  # what comes next would be the rest of this answer
            raise self._ended(broken) from None
        if error is not None:
            raise error
        return answer

    def close(self) -> None:
        """End the process, whatever it does; callable from any thread, more than once."""
        self._stderr.close()
        if (process := self._process) is None:
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _send(self, *message: object) -> Future[None]:
        """Begin to write a message, of which only arrays may not change from now on."""
        if self._process is None:
            raise WorkerError(self._why_not)
        return self._writer.submit(_write, _packed(message, self._shared), self._process.stdin)

    def _ended(self, broken: Exception) -> WorkerError:
        """Return the error of a process that has ended: the last that it said, or its code.

        One that goes on though its answer could not be taken is ended: it would wait for ever for
        somebody who takes the rest.
        """
        assert self._process is not None
        try:
            code = self._process.wait(_LAST_WORDS_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            return WorkerError(f"{type(broken).__name__}: {broken}")
        try:
            self._stderr.seek(0)
            last = self._stderr.read().decode(errors="replace").strip().rpartition("\n")[2]
        except (ValueError, OSError):  # closed from another thread
            return WorkerError("the process was ended")
        return WorkerError(last or f"the process ended with code {code}")


class _Pickler(pickle.Pickler):
    """Names what both sides hold, and leaves arrays where they are."""

    def __init__(
        self, text: BytesIO, shared: list[object], apart: list[pickle.PickleBuffer]
    ) -> None:
        super().__init__(text, pickle.HIGHEST_PROTOCOL, buffer_callback=apart.append)
        self._names = {id(one): number for number, one in enumerate(shared)}

    def persistent_id(self, one: object) -> int | None:
        return self._names.get(id(one))


class _Unpickler(pickle.Unpickler):
    """Finds what both sides hold, and what was left apart."""

    def __init__(self, pipe: BinaryIO, shared: list[object], apart: list[bytearray]) -> None:
        super().__init__(pipe, buffers=apart)
        self.persistent_load = shared.__getitem__  # type: ignore[method-assign]


def _packed(message: object, shared: list[object]) -> list[Any]:
    """Return what is written: the sizes of arrays, the arrays, and the message around them."""
    text, apart = BytesIO(), list[pickle.PickleBuffer]()
    _Pickler(text, shared, apart).dump(message)
    arrays = [one.raw() for one in apart]
    return [pickle.dumps([array.nbytes for array in arrays]), *arrays, text.getbuffer()]


def _write(parts: list[Any], pipe: Any) -> None:
    for part in parts:
        pipe.write(part)
    pipe.flush()


def _load(pipe: Any, shared: list[object]) -> Any:
    apart = [bytearray(size) for size in pickle.load(pipe)]
    for array in apart:
        if pipe.readinto(array) != len(array):
            raise EOFError
    return _Unpickler(pipe, shared, apart).load()


def place_of(error: BaseException) -> str:
    """Return where in this package an error happened, in this process or the one that was asked.

    >>> place_of(ValueError("never raised"))
    ''
    """
    if places := getattr(error, "__notes__", ()):
        return str(places[-1])
    here = Path(__file__).parent.name
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if here in Path(frame.filename).parts]
    return f"{Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else ""


def _picklable(error: Exception) -> Exception:
    """Return an error that can be sent, with the place where it happened as a note."""
    place = place_of(error)
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    error.add_note(place)
    return error


def main() -> None:
    """Be the process: answer until the pipe ends."""
    requests, answers = sys.stdin.buffer, sys.stdout.buffer
    sys.stdout = sys.stderr  # what is printed is no answer
    if hasattr(os, "nice"):
        os.nice(int(sys.argv[2]))
    defer_unused()
    gc.disable()  # hundreds of modules are nothing to collect: a tenth of the time
    for name in sys.argv[1].split():
        import_module(name)
    gc.freeze()
    gc.enable()
    shared: list[object] = []
    while True:
        try:
            function, arguments, *named = _load(requests, shared)
        except EOFError:
            return
        if function is None:
            shared += arguments
            continue
        answer: tuple[Exception | None, object]
        try:
            answer = None, function(*arguments, **named[0])
        except Exception as error:
            answer = _picklable(error), None
        del function, arguments, named
        _write(_packed(answer, shared), answers)
        del answer


if __name__ == "__main__":
    main()
