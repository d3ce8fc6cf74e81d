"""The analyser: events in, a result out whenever one is asked for."""

from __future__ import annotations

import copy
from dataclasses import dataclass

from allanscope.analysis.state import StreamState
from allanscope.samples import Block, Event, Gap, Notice, StreamInfo

__all__ = ["Analyser", "AnalyserSettings", "Mark"]

MOST_CONFIGURATIONS = 8
MOST_ERRORS = 16
"""A device that tells of ever new scales, or of ever new troubles, must not fill the memory."""


@dataclass(frozen=True, slots=True)
class AnalyserSettings:
    """How finely and how long to remember.

    Attributes
    ----------
    part : str
        The part, when the user named one; it overrules what the stream claims.
    per_octave : int
        Averaging times in each octave.
    level : float
        Confidence of every interval.
    history_rows : int
        Rows of block means that are kept: live runs keep fewer than an analysis to the end.
    gathered_rows : int
        Rows that are summed up at a time; the more, the better two cores share the work.
    threads : int
        Axes that the closed loop works on at a time.
    """

    part: str = ""
    per_octave: int = 4
    level: float = 0.95
    history_rows: int = 1 << 18
    gathered_rows: int = 1 << 13
    threads: int = 2


@dataclass(frozen=True, slots=True)
class Mark:
    """A remark of the user.

    Attributes
    ----------
    position : int
        Samples from the start of the configuration, those that are known to be lost among them:
        when that was is known only with the true rate.
    nominal_hz : float
        Rate that the configuration claimed.
    text : str
        What the user said.
    """

    position: int
    nominal_hz: float
    text: str


class Analyser:
    """Take the events of one session, in order.

    A device that comes back with other axes, scales or rate starts a new configuration with sums
    of its own: counts of different scale are never added. When it returns to one that it had
    before, the sums of that one go on. The configuration with the most samples is the one that is
    reported, and a remark says that there were others.
    """

    def __init__(self, settings: AnalyserSettings | None = None) -> None:
        self.settings = settings or AnalyserSettings()
        self.configurations: list[StreamState] = []
        self.marks: list[Mark] = []
        self.errors: list[str] = []
        self.assumptions: list[str] = []

    @property
    def state(self) -> StreamState | None:
        """The configuration in force."""
        return self.configurations[-1] if self.configurations else None

    def take(self, event: Event) -> None:
        """Take one event."""
        match event:
            case Block():
                assert self.state is not None, "a decoder describes a stream before its samples"
                self.state.block(event)
            case Gap():
                if self.state is not None:
                    self.state.gap(event)
            case StreamInfo():
                self._configure(event)
            case Notice(kind="mark"):
                self.mark(event.text)
            case Notice(kind="error"):
                self.errors = _with(self.errors, event.text)
            case Notice(fields=fields) if "assumed" in fields:
                self.assumptions = _with(self.assumptions, event.text)

    def mark(self, text: str) -> None:
        """Remember a remark at the present moment of the run."""
        state = self.state
        position = state.samples + state.lost if state else 0
        self.marks.append(Mark(position, state.info.nominal_hz if state else 0.0, text))

    def frozen(self) -> Analyser:
        """Return a copy that later events do not change, to be summarised in another thread."""
        return copy.deepcopy(self)

    def _configure(self, info: StreamInfo) -> None:
        same = (one for one in self.configurations if one.info.configuration == info.configuration)
        known = next(same, None)
        if known is None:
            asked = self.settings
            known = StreamState(info, asked.per_octave, asked.history_rows, asked.gathered_rows)
        else:
            self.configurations.remove(known)
            known.info = info
        self.configurations.append(known)
        if len(self.configurations) > MOST_CONFIGURATIONS:
            least = min(self.configurations[:-1], key=lambda one: one.samples)
            self.configurations.remove(least)


def _with(lines: list[str], line: str) -> list[str]:
    """Return the latest lines, each once: a night may bring the same one a thousand times."""
    return [*(one for one in lines if one != line), line][-MOST_ERRORS:]
