"""Why text is no table that can be read: which line, which column, what stands there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice

from allanscope.samples import AXES
from allanscope.sanitize import plain_line, text_of
from allanscope.wire.lines import is_text
from allanscope.wire.text.columns import (
    Column,
    Columns,
    cells_of,
    column_of,
    columns_of,
    in_unknown_unit,
    unnamed,
)
from allanscope.wire.text.table import is_number, joined_dates
from allanscope.wire.text.units import DIVISORS, LARGEST

__all__ = ["why_no_row", "why_no_rows"]

_SHOWN = 3
_UNREAD = 3
"""Columns beside the six axes that an example of names shows."""
_LOOKED_AT = 1 << 14
_LONGEST_CELL, _LONGEST = 16, 220
_ENDS = re.compile(rb"\r\n|\n\r|\n|\r")
_MARKS = "#%/ "


def why_no_rows(sample: bytes) -> str:
    r"""Return why the first lines of a text are no rows; empty where it is no text at all.

    Parameters
    ----------
    sample : bytes
        The first bytes received.

    Examples
    --------
    >>> why_no_rows(b"gx[dps],gy[dps]\n0.1,abc\n")
    "line 2, column 2: 'abc' is not a number"
    >>> why_no_rows(b"p,q\n1,2\n")
    "line 1: no axis among 'p', 'q'; names are t gx gy gz ax ay az temp; line 2: ..."
    """
    if len(sample) > _LOOKED_AT:
        # The line that the cut goes through would be short of cells.
        sample = sample[: max(sample.rfind(b"\n", 0, _LOOKED_AT), 0) or _LOOKED_AT]
    if not is_text(sample):
        return ""
    return text_of("; ".join(islice(_reasons(sample), _SHOWN)).encode(), _LONGEST)


def _reasons(sample: bytes) -> Iterator[str]:
    """Yield what is wrong with each line."""
    columns: Columns | None = None
    worded = False
    for count, line in enumerate(_ENDS.split(sample), start=1):
        cells = cells_of(plain_line(joined_dates(line)))
        where = f"line {count}"
        numbers = [is_number(cell) for cell in cells]
        if not cells:
            continue
        if not any(numbers):
            named = columns_of([cell.lstrip(_MARKS) for cell in cells])
            if named is not None:
                columns = named
            elif columns is None:
                if not worded:
                    yield f"{where}: {_no_axis(cells)}"
                worded = True
        elif columns is not None or all(numbers):
            taken = columns or unnamed(len(cells))
            if taken is None:
                yield f"{where}: {_nameless(len(cells))}"
                return
            if why := why_no_row(taken, line):
                yield f"{where}, {why}" if why.startswith("column") else f"{where}: {why}"
        else:
            yield f"{where}: {_shown(cells[numbers.index(False)])} is not a number"


def why_no_row(columns: Columns, line: bytes) -> str:
    """Return why a line is no row of these columns: which column, what stands there.

    >>> from allanscope.wire.text.columns import Column
    >>> why_no_row((Column("gyro", "dps", 0), None), b"none,2")
    "column 1: 'none' is not a number"
    >>> why_no_row((Column("gyro", "dps", 0),), b"1e300")
    "column 1: '1e300' is more than any sensor reads"
    """
    cells = cells_of(plain_line(joined_dates(line)))
    if len(cells) != len(columns):
        return f"{len(cells)} cells where the header names {len(columns)} columns"
    for number, (column, cell) in enumerate(zip(columns, cells, strict=True), start=1):
        if column is None or not cell:
            continue
        if not is_number(cell):
            return f"column {number}: {_shown(cell)} is not a number"
        if column.axis >= 0 and _is_too_large(column, cell):
            return f"column {number}: {_shown(cell)} is more than any sensor reads"
    return ""


def _is_too_large(column: Column, cell: str) -> bool:
    try:
        value = float(cell.replace(",", ".", 1))
    except ValueError:  # a time of day
        return False
    return abs(value) > LARGEST * DIVISORS[column.quantity].get(column.unit, 1.0)


def _nameless(count: int) -> str:
    """Return what to write above rows of so many numbers.

    >>> _nameless(9)
    "9 columns without names; write names above, e.g. 'gx gy gz ax ay az - - -' (also t, temp)"
    """
    names = [*AXES[:count], *["-"] * min(count - len(AXES), _UNREAD)]
    if count > len(AXES) + _UNREAD:
        names.append("...")
    columns = (
        "1 column without a name; write a name"
        if count == 1
        else (f"{count} columns without names; write names")
    )
    return f"{columns} above, e.g. '{' '.join(names)}' (also t, temp)"


def _no_axis(cells: list[str]) -> str:
    strange = [cell for cell in cells if in_unknown_unit(cell)]
    if strange:
        return f"the unit of {_shown(strange[0])} is not known"
    named = ", ".join(_shown(cell) for cell in cells[:3] if column_of(cell) is None)
    return f"no axis among {named}; names are t {' '.join(AXES)} temp"


def _shown(cell: str) -> str:
    return repr(text_of(cell.encode(), _LONGEST_CELL))
