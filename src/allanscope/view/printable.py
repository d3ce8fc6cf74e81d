"""Text from devices and files, made safe to show.

A device may send anything as its name: an escape sequence that repaints the terminal, a line break
that forges a line of the log, a direction mark that turns a number round, a picture link that makes
a viewer fetch it. What is shown goes through here first.
"""

from __future__ import annotations

from allanscope.visible import visible

__all__ = ["markdown", "printable"]

_LONGEST = 400


def printable(text: object) -> str:
    r"""Return one line of visible characters; every other character becomes U+FFFD.

    Examples
    --------
    >>> printable("SensorTile \x1b[2J v1.2")
    'SensorTile \ufffd[2J v1.2'
    """
    line = visible(str(text))
    return line if len(line) <= _LONGEST else f"{line[:_LONGEST]} ..."


def markdown(text: object) -> str:
    r"""Return a printable line in which no character means anything to Markdown.

    Examples
    --------
    >>> print(markdown("a|b ![x](http://y)"))
    a\|b \!\[x\](http://y)
    """
    return "".join(f"\\{c}" if c in "\\`*_{}[]<>#|!~" else c for c in printable(text))
