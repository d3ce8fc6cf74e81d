r"""Text from devices, files and users, without what a terminal or a page would obey.

A port may say anything, and so may a file or a name: an escape sequence that repaints the screen, a
line break that forges a line of the log, a direction mark that turns a number round, a picture link
that a viewer would fetch. It goes through here before it is shown::

    bytes off a wire ─┬▶ plain_line ─▶ text_of      one short line of what was said
                      └▶ excerpt                    escaped byte for byte, where it is unknown
    text ─▶ sanitize ─▶ one_line ─▶ markdown        for screens and logs; for pages

And a stream may not be able to encode what is shown: Windows encodes piped output in the code page
of the machine, and the C locale may stand for ASCII. Neither has τ or √, and a strict stream raises
at the first of them; `spell_out` has the characters spelled out instead.
"""

from __future__ import annotations

import codecs
import io
import re
import sys
from contextlib import suppress
from typing import TextIO

__all__ = [
    "encodable",
    "excerpt",
    "markdown",
    "one_line",
    "plain_line",
    "print_error",
    "sanitize",
    "spell_out",
    "spell_out_standard_streams",
    "text_of",
    "without_escapes",
]

_ESCAPE_SEQUENCE = re.compile(
    rb"\x1b(?:\[[0-?]*[ -/]*[@-~]"  # CSI: colours, cursor movement
    rb"|[\]PX^_][^\x07\x1b]*(?:\x07|\x1b\\)?"  # OSC, DCS and other strings, up to their end
    rb"|[ -/]*[0-~])?"  # two-byte escapes, and a bare ESC
)
_KINDS = (
    (b"PK\x03\x04", "a ZIP archive, as .npz and .xlsx files are"),
    (b"\x93NUMPY", "a NumPy array"),
    (b"\x89PNG", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"%PDF", "a PDF document"),
    (b"PAR1", "a Parquet table"),
    (b"\x89HDF", "an HDF5 file"),
    (b"\x7fELF", "a program"),
    (b"RRF2", "a Rerun recording"),
)
"""How common files begin that are given for a capture by mistake."""
_LONGEST_LINE = 400


def sanitize(text: str, keep: str = "") -> str:
    r"""Return the text with every character that is not printable, nor to be kept, as U+FFFD.

    Examples
    --------
    >>> sanitize("SensorTile \x1b[2J v1.2\n", keep="\n")
    'SensorTile \ufffd[2J v1.2\n'
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else "\N{REPLACEMENT CHARACTER}" for c in text)


def encodable(text: object) -> str:
    """Return text without the bytes of a path that stand for no character, which no file takes."""
    return str(text).encode("utf-8", "replace").decode()


def one_line(text: object) -> str:
    r"""Return one line of bounded length in which every character is printable.

    Examples
    --------
    >>> one_line("SensorTile \x1b[2J v1.2")
    'SensorTile \ufffd[2J v1.2'
    """
    line = sanitize(str(text))
    return line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]} ..."


def print_error(text: object) -> None:
    """Print one line on standard error, with the program's name; a closed stream is no error."""
    with suppress(OSError, ValueError):
        print(f"allanscope: {sanitize(str(text))}", file=sys.stderr, flush=True)


def markdown(text: object) -> str:
    r"""Return one line, however long, in which no character means anything to Markdown.

    Examples
    --------
    >>> print(markdown("a|b ![x](http://y)"))
    a\|b \!\[x\](http://y)
    """
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>#|!~" else c for c in sanitize(str(text)))


def text_of(data: bytes, limit: int = 200) -> str:
    r"""Return what a line says, without escape sequences and control characters.

    Parameters
    ----------
    data : bytes
        One line, in UTF-8 or Latin-1 (stock firmware writes the degree sign in Latin-1).
    limit : int
        Longest text to return, in characters.

    Examples
    --------
    >>> text_of(b"\x1b[31mOverrun\x1b[0m at 12 s\x07\r\n")
    'Overrun at 12 s'
    """
    text = " ".join(plain_line(data[: 16 * limit]).split())
    return text if len(text) <= limit else text[: limit - 1] + "…"


def without_escapes(data: bytes) -> bytes:
    """Return bytes without escape sequences: what is left is what would have been read."""
    return _ESCAPE_SEQUENCE.sub(b"", data) if b"\x1b" in data else data


def plain_line(data: bytes) -> str:
    r"""Return a line without escape sequences; control characters but tabs become spaces.

    >>> plain_line(b"1\t\x1b[0m2\x00")
    '1\t2 '
    """
    plain = without_escapes(data)
    try:
        text = plain.decode("utf-8")
    except UnicodeDecodeError:
        text = plain.decode("latin-1")
    if text.isprintable():
        return text
    return "".join(char if char.isprintable() or char == "\t" else " " for char in text)


def excerpt(data: bytes, limit: int = 160) -> str:
    r"""Return a sample of unknown bytes, escaped: printable ASCII as it is, the rest as ``\xhh``.

    Parameters
    ----------
    data : bytes
        The sample; where it begins like a common kind of file, its name follows.
    limit : int
        Longest text to return, in characters, without the kind.

    Examples
    --------
    >>> print(excerpt(b"\xf02\x01 hi\n"))
    \xf02\x01 hi\n
    >>> print(excerpt(b"\x89PNG\r\n" + bytes(99), 12))
    \x89PNG\r\n… (a PNG picture)
    """
    pieces = [chr(byte).encode("unicode_escape").decode("ascii") for byte in data[: max(limit, 0)]]
    kind = next((f" ({name})" for magic, name in _KINDS if data.startswith(magic)), "")
    shown = "".join(pieces)
    cut = len(data) > len(pieces) or len(shown) > limit
    while len(shown) > limit:
        shown = shown[: -len(pieces.pop())]
    return shown + "…" * cut + kind


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


_HANDLER = "allanscope.spelled_out"
codecs.register_error(_HANDLER, _spell)
