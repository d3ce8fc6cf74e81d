"""A Rich console that outlives its reader and writes to terminals of any encoding."""

from __future__ import annotations

import codecs
import io
import os
from typing import TextIO

from rich.console import Console

__all__ = ["SteadyConsole"]

_SPELLED = {
    "√": "sqrt ",
    "°": "deg ",
    "µ": "u",
    "±": "+-",
    "²": "^2",
    "³": "^3",
    "·": "*",
    "χ": "chi",
    "τ": "tau",
    "σ": "sigma",
    "…": "...",
    "↑": "^",
    "↓": "v",
    "→": "->",
    "━": "-",
    "╸": "-",
    "╺": "-",
}


class SteadyConsole(Console):
    """A console for jobs that go on whether or not somebody reads along.

    A reader that closes the pipe (``allanscope live | head``) silences it, where Rich would end
    the process. Characters that the stream cannot encode are spelled out.

    Parameters
    ----------
    stream : text file
        Where to write.
    soft_wrap : bool
        Leave long lines alone.
    """

    def __init__(self, stream: TextIO, soft_wrap: bool = False) -> None:
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors=_HANDLER)
        super().__init__(file=stream, highlight=False, markup=False, soft_wrap=soft_wrap)

    def on_broken_pipe(self) -> None:
        """Fall silent."""
        self.quiet = True
        # Python would complain about the pipe once more when it flushes the stream at its end.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, self.file.fileno())
        except OSError:
            pass
        finally:
            os.close(nowhere)


def _spell(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(_SPELLED.get(character, "?") for character in text), error.end


_HANDLER = "allanscope.spell"
codecs.register_error(_HANDLER, _spell)
