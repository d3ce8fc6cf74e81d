"""Text on streams that cannot encode all of it: characters spelled out instead of an error.

Windows encodes piped output in the code page of the machine, and the C locale may stand for ASCII.
Neither has τ or √, and a strict stream raises at the first of them.
"""

from __future__ import annotations

import codecs
import io
import sys
from typing import TextIO

__all__ = ["spell_out", "spell_out_standard_streams"]

_SPELLED = {
    "√": "sqrt ",
    "°": "deg ",
    "µ": "u",
    "μ": "u",
    "±": "+-",
    "×": "x",
    "−": "-",
    "²": "^2",
    "³": "^3",
    "·": "*",
    "χ": "chi",
    "τ": "tau",
    "σ": "sigma",
    "…": "...",
    "–": "-",
    "—": "-",
    "≤": "<=",
    "≥": ">=",
    "↑": "^",
    "↓": "v",
    "→": "->",
    "━": "-",
    "╸": "-",
    "╺": "-",
}


def spell_out(stream: TextIO) -> None:
    """Make a stream write ``sqrt`` for √ and the like where its encoding lacks the character.

    Characters without a spelling become a question mark. A stream in UTF-8 writes all as it is,
    but for halves of surrogate pairs, as names of files may hold them.
    """
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors=_HANDLER)


def spell_out_standard_streams() -> None:
    """Do so for standard output and standard error; a program without them is left alone."""
    for stream in (sys.stdout, sys.stderr):
        spell_out(stream)


def _spell(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(_SPELLED.get(character, "?") for character in text), error.end


_HANDLER = "allanscope.spelled"
codecs.register_error(_HANDLER, _spell)
