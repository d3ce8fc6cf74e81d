"""A Rich console that outlives its reader and writes to terminals of any encoding."""

from __future__ import annotations

import os
from typing import TextIO

from rich.console import Console

from allanscope.spelled import spell_out

__all__ = ["SteadyConsole"]


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
        spell_out(stream)
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
