"""What is summed up while samples pass by, and what the closed loop is given of it.

An `Analyser` takes events. Each configuration of the device has sums of its own, a `StreamState`:
as small after a night as after a minute. They are read at any moment without being changed.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import AllanBank, CurveChoices
from allanscope.analysis.comparison import ReferenceCurve
from allanscope.analysis.logger_padding import Padding
from allanscope.analysis.row_buffer import BUFFERED, BackgroundTask, RowBuffer, lowest_and_highest
from allanscope.clock import Clock
from allanscope.errors import UsageError
from allanscope.history import History, Record
from allanscope.noise import find_step
from allanscope.samples import INT16_MAX, INT16_MIN, Block, Event, Gap, Notice, StreamInfo
from allanscope.spectrum import Density, SpectrumBank
from allanscope.watch import Watch

__all__ = [
    "FEWEST_ROWS",
    "Analyser",
    "AnalyserSettings",
    "LoopInput",
    "Mark",
    "StreamState",
    "loop_input",
]

MOST_CONFIGURATIONS = 8
MOST_ERRORS = 16
"""A device that sends ever new scales or errors must not fill the memory."""

MOST_KEPT = 1 << 28
"""Numbers that are kept where the averaging times take the samples themselves: half a gigabyte."""

FEWEST_ROWS = 64
"""Rows below which nothing is fitted."""


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
    buffered_rows : int
        Rows that are summed up at a time; the more, the better two cores share the work.
    processes : int
        In which the closed loop of a long record works; the result does not depend on it.
    curves : CurveChoices
        How the curves of the final result are made.
    over_time : bool
        Keep what the Allan deviation over time needs.
    references : mapping
        Curves to compare with, by axis.
    full_scales : mapping
        Full scale by unit, ``dps`` and ``g``, where the user named one; otherwise the step of the
        values tells.
    """

    part: str = ""
    per_octave: int = 4
    level: float = 0.95
    history_rows: int = 1 << 18
    buffered_rows: int = 1 << 13
    processes: int = 1
    curves: CurveChoices = field(default_factory=CurveChoices)
    over_time: bool = True
    references: Mapping[str, ReferenceCurve] = field(default_factory=dict)
    full_scales: Mapping[str, float] = field(default_factory=dict)


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

    def feed(self, event: Event) -> None:
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
            known = StreamState(
                info,
                asked.per_octave,
                asked.history_rows,
                asked.buffered_rows,
                keep_samples=asked.curves.needs_samples,
                window_s=asked.curves.window_s if asked.over_time else None,
            )
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


class Temperature:
    """The last temperature, held from tick to tick, and the extremes of the run."""

    def __init__(self) -> None:
        self.first = np.nan
        self.last = np.nan
        self.lowest = np.inf
        self.highest = -np.inf

    def at_samples(self, block: Block) -> NDArray[np.float64] | None:
        """Return the temperature at each sample of a block, or None where there never was one."""
        ticks = block.ticks
        seen = np.isfinite(ticks.temperature_c)
        if seen.any():
            values = ticks.temperature_c[seen]
            if np.isnan(self.first):
                self.first = float(values[0])
            held = np.concatenate([[self.last], values])
            bounds = np.concatenate([[0], ticks.offset[seen], [len(block)]])
            self.last = float(values[-1])
            self.lowest = min(self.lowest, float(values.min()))
            self.highest = max(self.highest, float(values.max()))
            return np.repeat(held, np.diff(bounds))
        return None if np.isnan(self.last) else np.full(len(block), self.last)

    def summary(self) -> dict[str, float]:
        """Return first, last, lowest and highest in degC; empty when none was seen."""
        if np.isnan(self.first):
            return {}
        return {
            "first": self.first,
            "last": self.last,
            "lowest": self.lowest,
            "highest": self.highest,
        }


class StreamState:
    """The running sums of one configuration: as small after a night as after a minute.

    Parameters
    ----------
    info : StreamInfo
        What the samples mean.
    per_octave : int
        Averaging times in each octave.
    history_rows : int
        Most rows of block means that are kept for what needs a time series.
    buffered_rows : int
        Rows that are summed up at a time.
    keep_samples : bool
        Keep every sample too, for curves that no bank has.
    window_s : float or None
        Length of the windows of the Allan deviation over time, 0 for one that grows; None for none.
    """

    def __init__(
        self,
        info: StreamInfo,
        per_octave: int,
        history_rows: int,
        buffered_rows: int = BUFFERED,
        *,
        keep_samples: bool = False,
        window_s: float | None = None,
    ) -> None:
        rate_hz = info.nominal_hz or 1.0
        columns = len(info.axes)
        self.info = info
        self.bank = AllanBank(rate_hz, columns, per_octave, window=window_s)
        self.spectrum = SpectrumBank(rate_hz, axes=columns)
        self.history = History(columns, history_rows)
        self.clock = Clock.of(info)
        self.temperature = Temperature()
        self.samples = 0
        self.lost = 0
        self.unknown_losses = 0
        self.segments = 0
        self.lowest = np.full(columns, np.inf)
        self.highest = np.full(columns, -np.inf)
        self.saturated = np.zeros(columns, np.int64)
        self.counted = True
        self._in_segment = False
        self.padding = Padding()
        self._kept: list[NDArray[Any] | None] | None = [] if keep_samples else None
        self.watch = Watch(info)
        self.watch_failure = ""
        self._buffer = RowBuffer(buffered_rows)
        self._deviations = BackgroundTask()

    def block(self, block: Block) -> None:
        """Take a run of samples."""
        if not self._in_segment:
            self.segments += 1
            self._in_segment = True
        counts = block.counts
        self.counted = self.counted and np.issubdtype(counts.dtype, np.integer)
        # The numbers of the history: a device that restarts may count from nought again.
        first = self.samples + self.lost
        self.watch.ticks(first, block.ticks)
        self.clock.update(first, block.ticks)
        self.samples += len(block)
        temperature_c = self.temperature.at_samples(block)
        self._watch(counts)
        for piece in self._buffer.feed(counts, temperature_c):
            self._pass_on(*piece)

    def gap(self, gap: Gap) -> None:
        """Take a gap."""
        self.settle()
        self.release_padding()
        self._in_segment = False
        self.watch.gap(gap)
        self.bank.gap(gap.lost or 0)
        if self._kept is not None:
            self._kept.append(None)
        self.spectrum.gap()
        self.history.gap(gap.lost)
        self.clock.gap(gap)
        if gap.lost is None:
            self.unknown_losses += 1
        else:
            self.lost += gap.lost

    def settle(self) -> None:
        """Add the buffered rows to the sums; must come before any of the sums is read."""
        for piece in self._buffer.flush():
            self._pass_on(*piece)
        if not self.padding.is_trailing:
            self.release_padding()
        self._deviations.wait()

    def __getstate__(self) -> dict[str, Any]:
        self._deviations.wait()
        return self.__dict__

    def _pass_on(self, counts: NDArray[Any], temperature_c: NDArray[np.float64] | None) -> None:
        """Sum up what is not padding."""
        for piece in self.padding.feed(counts, temperature_c):
            self._sum_up(*piece)

    def _watch(self, counts: NDArray[Any]) -> None:
        """Look for changes; should that fail, the measurement goes on without."""
        if self.watch_failure:
            return
        try:
            self.watch.rows(counts)
        except Exception as error:
            self.watch_failure = f"{type(error).__name__}: {error}"

    def release_padding(self) -> None:
        """Sum up what waits at the end: the record goes on."""
        for piece in self.padding.release():
            self._sum_up(*piece)
        self._deviations.wait()

    def samples_with_gaps(self, column: int) -> NDArray[np.float64]:
        """Return the samples of one axis in counts, NaN at each gap, where they are kept."""
        missing = np.full(1, np.nan)
        pieces = [missing if one is None else one[:, column] for one in self._kept or ()]
        return np.concatenate([np.empty(0), *pieces])

    def _keep(self, counts: NDArray[Any]) -> None:
        """Keep a copy of samples, as many as memory is sure to have room for."""
        assert self._kept is not None
        if self.spectrum.samples * counts.shape[1] > MOST_KEPT:
            raise UsageError(
                f"more than {MOST_KEPT // counts.shape[1]} samples are too many for averaging "
                "times of one's own; use --per-octave, which keeps sums instead of samples"
            )
        self._kept.append(counts.copy())

    def _sum_up(self, counts: NDArray[Any], temperature_c: NDArray[np.float64] | None) -> None:
        self._deviations.do(len(counts), lambda: self.bank.update(counts))
        if self._kept is not None:
            self._keep(counts)
        self.spectrum.update(counts)
        self.history.update(counts, temperature_c)
        self._extremes(counts)

    def _extremes(self, counts: NDArray[Any]) -> None:
        lowest, highest = lowest_and_highest(counts)
        self.lowest = np.minimum(self.lowest, lowest)
        self.highest = np.maximum(self.highest, highest)
        if counts.dtype == np.int16:
            full = (lowest == INT16_MIN) | (highest == INT16_MAX)
            for column in np.flatnonzero(full):
                values = counts[:, column]
                at_end = (values == INT16_MAX) | (values == INT16_MIN)
                self.saturated[column] += int(np.count_nonzero(at_end))


@dataclass(frozen=True, slots=True)
class LoopInput:
    """A run so far, as the closed loop sees it.

    Attributes
    ----------
    record : Record
        Rows of all axes.
    densities : mapping of str to Density
        What there is above the rows of a long run.
    nominal_hz : float or None
        Sample rate that the device claims.
    rate_fit : (float, float) or None
        Measured rate and its standard error in Hz.
    """

    record: Record
    densities: Mapping[str, Density]
    nominal_hz: float | None
    rate_fit: tuple[float, float] | None

    @property
    def length_s(self) -> float:
        """Time that the rows cover, in s."""
        return len(self.record.values) / self.record.rate_hz

    def since(self, begin_s: float) -> LoopInput:
        """Return what there is from a time on; the densities of the whole run are left out."""
        return replace(self, record=self.record.between(begin_s), densities={})


def loop_input(state: StreamState) -> LoopInput:
    """Return what the sums of one configuration have to show."""
    state.settle()
    fit = state.clock.rate()
    rate_hz = fit.hz or 1.0
    claimed_hz = state.info.nominal_hz if state.info.rate_claimed else 0.0
    measured = None
    if fit.is_measured and state.info.nominal_hz:
        measured = (fit.hz, fit.hz * fit.uncertainty_ppm * 1e-6)
    return LoopInput(
        _record(state, rate_hz), _densities(state, rate_hz), claimed_hz or None, measured
    )


def _record(state: StreamState, rate_hz: float) -> Record:
    """Return the memory of the run; the step of numbers that are no counts is found from them."""
    record = state.history.record(rate_hz, state.info.axes, state.info.scale)
    if state.counted:
        return record
    steps = tuple(find_step(column * record.stride) for column in record.values.T)
    return replace(record, lsb=steps)


def _densities(state: StreamState, rate_hz: float) -> dict[str, Density]:
    """Return the measured density of every axis."""
    found = state.spectrum.densities(rate_hz, list(state.info.scale))
    return dict(zip(state.info.axes, found, strict=True))
