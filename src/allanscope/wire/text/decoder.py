"""Delimited and labelled text to events."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import cast

from allanscope.samples import Event, GapReason, Notice
from allanscope.sanitize import plain_line, without_escapes
from allanscope.wire.base import LinkStats, WireSettings
from allanscope.wire.lines import Lines
from allanscope.wire.row_events import RowEvents
from allanscope.wire.text.columns import (
    Columns,
    cells_of,
    columns_of,
    columns_under_groups,
    in_unknown_unit,
    names_no_sensor,
    unnamed,
    with_units_below,
)
from allanscope.wire.text.interpretation import TextInterpreter
from allanscope.wire.text.labelled import (
    LabelledRow,
    LabelledRows,
    Sentence,
    read_labelled,
    sentence_in,
)
from allanscope.wire.text.refusal import why_no_row
from allanscope.wire.text.table import Table, is_number, joined_dates, realigned
from allanscope.wire.text.units import Quantity

__all__ = ["TextDecoder"]

_COMMENT = re.compile(r"\A\s*(?:#|%|//)\s*")
"""A mark before a header, as `numpy.savetxt` and MATLAB's users set it: no part of a name."""
_ENOUGH_UNNAMED = 3
_ENOUGH_MISALIGNED = 3
_LONGEST_QUOTE = 60
_MOST_REPORTED = 3
_WORTH_A_CALL = 4096
"""Bytes from which on rows are read together."""
_MOST_EXACT = 1024
PATIENCE = 1024
"""Rows of a file that are looked at where their times come unevenly."""


class TextDecoder:
    """Bytes of text to events.

    A header with names that are known starts a table. Without one, three lines of the same three,
    four, six or seven numbers do. Before either, lines with labels are listened to; once a kind of
    line has been chosen it stays. Everything else is left alone.

    A device that repeats its header may have it damaged on the way. So one that is almost the one
    in force, or that the rows do not fit, is believed only when it is said again.

    Parameters
    ----------
    settings : WireSettings
        What the user said about the device.

    Attributes
    ----------
    named : bool
        Whether the text itself says what its numbers are.
    """

    def __init__(self, settings: WireSettings) -> None:
        self.stats = LinkStats()
        self.named = False
        self._lines = Lines()
        self._sensor = cast("Quantity", settings.sensor)
        self._interpreter = TextInterpreter(settings)
        self._rows = RowEvents(self.stats, self._interpreter.decide, patience=PATIENCE)
        self._table: Table | None = None
        self._unconfirmed: Columns = ()
        self._labelled = LabelledRows(self._interpreter.temperature_lsb_per_c)
        self._unnamed: list[bytes] = []
        self._misaligned: list[tuple[bytes, int]] = []
        self._alignment_decided = False
        self._left_out: tuple[str, ...] = ()
        self._other_lines = 0
        self._sentences = b""
        self._heading = 0
        self._groups: list[str] = []
        self._host_s = math.nan
        self._joining = True
        self._reported = 0

    def feed(self, data: bytes, host_s: float) -> list[Event]:
        """Take bytes that arrived at host time `host_s` and return what they complete."""
        self.stats.bytes += len(data)
        self._host_s = host_s
        dropped = self._lines.dropped
        events: list[Event] = []
        position, exact = 0, 1
        while position < len(data):
            rows = self._plain_rows(memoryview(data)[position:])
            if rows:
                position, exact = position + rows, 1
                continue
            # What is not plain is looked at line by line, more of them where nothing is.
            stop = position
            for _ in range(exact):
                stop = data.find(b"\n", stop) + 1 or len(data)
                if stop == len(data):
                    break
            for line in self._lines.feed(data[position:stop]):
                events += self._line(line)
            position, exact = stop, min(2 * exact, _MOST_EXACT)
        if self._lines.dropped > dropped:
            self._damage()
        return events + self._rows.events()

    def _plain_rows(self, data: memoryview) -> int:
        """Take the rows of plain numbers that a text begins with; return their bytes."""
        table = self._table
        begun = self._joining or self._lines.partial or self._misaligned
        if table is None or begun or len(data) < _WORTH_A_CALL:
            return 0
        found = table.plain_rows(data)
        if found is None:
            return 0
        self.stats.frames += len(found.values)
        self._lines.skip(found.newlines)
        self._rows.extend(found.values, found.time_s, self._host_s, found.degrees)
        return found.size

    def interrupt(self, reason: str) -> list[Event]:
        """Forget a partial line, e.g. after an unplug; the next Block follows a Gap."""
        self._lines.reset()
        self._joining = True
        self._rows.interrupt(cast("GapReason", reason))
        return []

    def finish(self) -> list[Event]:
        """Return what the end of the stream completes: a last line, rows that were held back."""
        events = self._line(self._lines.flush()) + self._count_misaligned_as_damaged()
        if self._table is None and not self._labelled.chosen:
            self._add_rows(self._labelled.choose())
        return events + self._rows.events(final=True)

    def _line(self, line: bytes) -> list[Event]:
        line = joined_dates(without_escapes(line))
        sentence = sentence_in(line)
        if sentence is not None:
            return self._sentence(sentence)
        joining, self._joining = self._joining, False
        if joining and not math.isnan(self._host_s) and _only_numbers(line):
            # From a port the first line may be the tail of one; a file begins with its beginning.
            return []
        if self._table is not None and self._row(self._table, line):
            return self._count_misaligned_as_damaged() if self._misaligned else []
        if self._unconfirmed and Table(self._unconfirmed).row(line) is not None:
            return self._start_table(self._unconfirmed) + self._line(line)
        return self._other_line(line)

    def _sentence(self, sentence: Sentence) -> list[Event]:
        """Take a sentence: the first name that is known, or else has numbers, is the stream."""
        self._joining = False
        if self._sentences and sentence.name != self._sentences:
            self.stats.unknown += 1
            return []
        if not sentence.checksum_ok:
            self.stats.crc_errors += 1
            self._damage()
            return []
        if sentence.columns is not None and not self._sentences:
            self._sentences = sentence.name
            self.named = True
            return self._start_table(sentence.columns) + self._line(sentence.values)
        return self._line(sentence.values)

    def _other_line(self, line: bytes) -> list[Event]:
        """Take a line that is not a row of the table in force, if there is one."""
        text = plain_line(line)
        cells = cells_of(text)
        numbers = [is_number(cell) for cell in cells if cell]
        if not numbers:
            return []
        if all(numbers):
            return self._numbers(line, text, len(cells))
        if self._table is None:
            self._interpreter.note(text)
        self._other_lines += 1
        if self._other_lines > 2 * len(self._unnamed) + 2:
            self._unnamed.clear()
        if not any(numbers) and not self._labelled.chosen:
            events = self._header(cells_of(_COMMENT.sub("", text)))
            if events is not None:
                return events
        if self._table is not None and 2 * sum(numbers) >= len(numbers):
            return self._bad_row(text)
        self._labelled_line(text, len(cells))
        return []

    def _header(self, cells: list[str]) -> list[Event] | None:
        """Take a line without numbers, None where it names neither columns nor their units."""
        below = self._units_below(cells)
        if below is not None:
            return self._start_table(below, self._left_out)
        groups, self._groups = self._groups, cells
        grouped = columns_under_groups(groups, cells) if self._table is None else None
        if grouped is None and cells[:1] == [""]:
            cells = cells[1:]  # a row number or a time without a name, as the rows will show
        columns = grouped or columns_of(cells, self._unnamed_sensor)
        if columns is None:
            return None
        self.named = True
        left_out = tuple(
            f"the unit of {cell} is not known: that column is left out"
            for cell in cells
            if in_unknown_unit(cell)
        )
        others = [
            cell
            for cell, column in zip(cells, columns, strict=False)
            if column is None and cell and not in_unknown_unit(cell)
        ]
        if others:
            left_out += (f"columns left out: {_quote(', '.join(others))}",)
        if self._needs_confirmation(columns):
            return []
        self._left_out = left_out
        bare = grouped is None and names_no_sensor(cells)
        why = "only the name of the file tells the sensor" if self._sensor else "no sensor is named"
        return self._start_table(columns, left_out, why if bare else "")

    @property
    def _unnamed_sensor(self) -> Quantity:
        """The sensor of columns that are called just x, y and z."""
        return "accel" if "accel" in self._interpreter.given else self._sensor or "gyro"

    def _row(self, table: Table, line: bytes) -> bool:
        row = table.row(line)
        if row is None:
            return False
        values, time_s, degrees = row
        self.stats.frames += 1
        self._rows.add(values, time_s, self._host_s, degrees)
        return True

    def _numbers(self, line: bytes, text: str, count: int) -> list[Event]:
        """Take a line of nothing but numbers that is not a row of the table."""
        if self._table is not None:
            held = self._hold_misaligned(self._table, line)
            return self._bad_row(text) if held is None else held
        if self._labelled.chosen or count == self._heading or unnamed(count) is None:
            self.stats.unknown += 1
            return []
        if self._unnamed and len(cells_of(plain_line(self._unnamed[0]))) != count:
            self._unnamed.clear()
        self._other_lines = self._other_lines if self._unnamed else 0
        self._unnamed.append(line)
        return self._start_unnamed_table(count) if len(self._unnamed) >= _ENOUGH_UNNAMED else []

    def _hold_misaligned(self, table: Table, line: bytes) -> list[Event] | None:
        """Hold a row that may have one cell more or fewer than the header, before any has fitted.

        Returns None for one that is simply damaged.
        """
        if table.rows or self._unconfirmed or self._alignment_decided:
            return None
        self._misaligned.append((line, self._lines.number))
        if len(self._misaligned) < _ENOUGH_MISALIGNED:
            return []
        lines = [one for one, _ in self._misaligned]
        found = realigned(table.columns, [cells_of(plain_line(one)) for one in lines])
        if found is None:
            return self._count_misaligned_as_damaged()
        self._misaligned.clear()
        columns, remark = found
        self._start_table(columns, (*self._left_out, remark))
        return [event for one in lines for event in self._line(one)]

    def _count_misaligned_as_damaged(self) -> list[Event]:
        """Take rows that were held because they do not fit the header for damaged ones."""
        held, self._misaligned = self._misaligned, []
        self._alignment_decided = True
        return [event for line, number in held for event in self._bad_row(plain_line(line), number)]

    def _start_unnamed_table(self, count: int) -> list[Event]:
        """Take a table without a header for what its number of columns suggests."""
        columns = unnamed(count)
        assert columns is not None
        self._start_table(columns, by_position="no header")
        lines, self._unnamed = self._unnamed, []
        return [event for line in lines for event in self._line(line)]

    def _units_below(self, cells: Sequence[str]) -> Columns | None:
        """Return the columns in force with the units that a second line of the header gives."""
        table = self._table
        if table is None or table.rows or self._misaligned:
            return None
        columns = with_units_below(table.columns, cells)
        return None if columns == table.columns else columns

    def _needs_confirmation(self, columns: Columns) -> bool:
        """Return whether a header may be the one in force, damaged; the rows after it will tell."""
        before, self._unconfirmed = self._unconfirmed, ()
        if self._table is None or columns in (self._table.columns, before):
            return False
        known = self._table.columns
        if len(columns) == len(known):
            changed = [old for old, new in zip(known, columns, strict=True) if old != new]
            if len(changed) > 1 or changed[0] is None:
                return False
        self._unconfirmed = columns
        self.stats.resyncs += 1
        return True

    def _start_table(
        self, columns: Columns, assumed: tuple[str, ...] = (), by_position: str = ""
    ) -> list[Event]:
        if self._table is not None and self._table.columns == columns:
            return []
        self._unconfirmed = ()
        self._misaligned.clear()
        self._alignment_decided = False
        events = self._rows.change() if self._table is not None else []
        self._table = Table(columns, self._interpreter.given.get("time", ""))
        self._interpreter.expect(self._table.units, assumed, self._table, by_position)
        return events

    def _labelled_line(self, text: str, count: int) -> None:
        labelled = read_labelled(text) if self._table is None else None
        if labelled is not None:
            self._add_rows(self._labelled.update(labelled))
            return
        self._heading = count if count > 1 else 0
        if self._labelled.chosen and self._labelled.has_chosen_label(text):
            self._damage()
        else:
            self.stats.unknown += 1

    def _add_rows(self, rows: list[LabelledRow]) -> None:
        if not rows:
            return
        self.named = True
        self._interpreter.expect(self._labelled.units)
        for values, degrees in rows:
            self.stats.frames += 1
            self._rows.add(values, math.nan, self._host_s, degrees)

    def _bad_row(self, text: str, number: int = 0) -> list[Event]:
        """Leave out a line that should be a row; of a file, say why of the first few."""
        self._damage()
        if self._reported == _MOST_REPORTED or not math.isnan(self._host_s):
            return []
        self._reported += 1
        why = why_no_row(self._table.columns, text.encode()) if self._table is not None else ""
        line = (
            f"line {number or self._lines.number} is not a row of the table: {_quote(text)!r}"
            f"{f' ({why})' if why else ''}; such lines are skipped"
        )
        return [Notice("error", line)]

    def _damage(self) -> None:
        self.stats.resyncs += 1
        self._rows.note_damage()


def _only_numbers(line: bytes) -> bool:
    return all(is_number(cell) for cell in cells_of(plain_line(line)) if cell)


def _quote(text: str) -> str:
    """Return the beginning of a text, marked as such where it goes on."""
    return text if len(text) <= _LONGEST_QUOTE else text[:_LONGEST_QUOTE] + "…"
