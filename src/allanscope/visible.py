"""Text from devices, files and users, without what a terminal or a page would obey.

A name may hold an escape sequence that repaints the screen, a line break that forges a line of the
log, or a direction mark that turns a number round.
"""

from __future__ import annotations

__all__ = ["visible"]


def visible(text: str, keep: str = "") -> str:
    r"""Return the text with every character that is not printable, nor to be kept, as U+FFFD.

    Examples
    --------
    >>> visible("SensorTile \x1b[2J v1.2\n", keep="\n")
    'SensorTile \ufffd[2J v1.2\n'
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else "\N{REPLACEMENT CHARACTER}" for c in text)
