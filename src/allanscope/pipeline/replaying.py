"""To the end, without a viewer: a file through decoder and analyser in megabytes, on two cores.

::

    thread "prefetch"  unpack ──▶ decode ──▶ events of 4 MB of bytes
    caller           spectrum, history, clock            ◀──┘
    thread "sums"    deviations, one piece behind        ◀──┘

The second thread decodes the next piece while the last one is summed up. Everything that takes
long is compiled code that releases the interpreter's lock. The result is that of taking the same
reads one by one, to the last bit: see `allanscope.analysis.row_buffer`.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self, TypeVar

import numpy as np

from allanscope.analysis import Analyser
from allanscope.errors import InputError
from allanscope.pipeline.decoding import Decoding
from allanscope.recording import Buffer
from allanscope.samples import Block, Event, Notice, Ticks
from allanscope.sources import FileSource, RecordedSource, Source, open_file
from allanscope.view import progress

__all__ = ["InputLength", "buffers_of", "events_of", "feed_analyser", "prefetch"]


Item = TypeVar("Item")


def buffers_of(source: Source) -> Iterator[Buffer]:
    """Yield all that a recording, a capture or a text holds, in pieces of megabytes.

    Raises
    ------
    InputError
        When the file cannot be read.
    """
    if isinstance(source, RecordedSource):
        yield from source.recording.buffers()
        return
    first = np.zeros(1, np.int64)
    while (chunk := source.read()).event != "end":
        yield Buffer(chunk.data, first, np.array([chunk.host_ns]), chunk.event, chunk.host_ns)


def events_of(
    path: Path,
    decoding: Decoding,
    quiet: bool,
    doing: str,
    on_buffer: Callable[[Buffer], None] | None = None,
) -> Iterator[Event]:
    """Yield the events of a recording or a capture, in order, to its end.

    `on_buffer` is called with every piece of the file, in another thread.

    Raises
    ------
    InputError
        When the file cannot be read or no wire format fits it.
    """
    source = open_file(path)
    length = InputLength.of(source)

    def decoded(buffers: Iterable[Buffer]) -> Iterator[tuple[float, list[Event]]]:
        for buffer in buffers:
            if on_buffer is not None:
                on_buffer(buffer)
            yield length.of_buffer(buffer), decoding.feed_buffer(buffer)
        yield 0.0, [*decoding.finish(), *_damage_of(source)]

    try:
        with progress(length.total, doing, unit=length.unit, quiet=quiet) as advance:
            for size, events in prefetch(decoded(buffers_of(source))):
                yield from events
                advance(size)
    except InputError as error:
        if str(path) in str(error):
            raise
        raise InputError(f"{path}: {error}") from None
    finally:
        source.close()


def _damage_of(source: Source) -> list[Event]:
    """Return what of a recording could not be read, once it has been read: the largest part."""
    if not isinstance(source, RecordedSource):
        return []
    found = [damage for damage in source.recording.damage if damage.length]
    if not found:
        return []
    worst = max(found, key=lambda damage: damage.length)
    text = f"damaged: {worst}"
    if len(found) > 1:
        text += f", and {len(found) - 1} more places; allanscope recover names them"
    return [Notice("error", text, {"host": 1})]


def feed_analyser(
    path: Path,
    decoding: Decoding,
    analyser: Analyser,
    quiet: bool,
    on_buffer: Callable[[Buffer], None] | None = None,
) -> Analyser:
    """Take a whole file into an analyser and return it."""
    events = events_of(path, decoding, quiet, "analysing", on_buffer)
    for event in joined(events, analyser.settings.buffered_rows):
        analyser.feed(event)
    return analyser


def joined(events: Iterable[Event], rows: int) -> Iterator[Event]:
    """Yield events with contiguous Blocks joined until they have so many rows.

    A device that tells its status once a second cuts its samples as often, and every Block costs
    as much as a thousand rows. Such remarks are passed on before the Block that they are in; a
    mark stays where it was set.

    Examples
    --------
    >>> blocks = [Block(at, np.zeros((3, 1), np.int16), Ticks.none()) for at in (0, 3)]
    >>> status = Notice("status", "sent 3")
    >>> [type(event).__name__ for event in joined([blocks[0], status, blocks[1]], 8)]
    ['Notice', 'Block']
    """
    held: list[Block] = []
    held_rows = 0
    for event in events:
        if isinstance(event, Notice) and event.kind != "mark":
            yield event
            continue
        if held and not (_is_like(event, held[0]) and held_rows < rows):
            yield _one_block(held)
            held, held_rows = [], 0
        if isinstance(event, Block):
            held.append(event)
            held_rows += len(event)
        else:
            yield event
    if held:
        yield _one_block(held)


def _is_like(event: Event, block: Block) -> bool:
    return isinstance(event, Block) and event.counts.dtype == block.counts.dtype


def _one_block(blocks: list[Block]) -> Block:
    """Return contiguous Blocks as one."""
    first, *others = blocks
    if not others:
        return first
    begins = np.cumsum([0, *map(len, blocks[:-1])])
    ticks = [block.ticks for block in blocks]
    return Block(
        first.index,
        np.concatenate([block.counts for block in blocks]),
        Ticks(
            np.concatenate([at + one.offset for at, one in zip(begins, ticks, strict=True)]),
            np.concatenate([one.device_s for one in ticks]),
            np.concatenate([one.host_s for one in ticks]),
            np.concatenate([one.temperature_c for one in ticks]),
        ),
    )


@dataclass(slots=True)
class InputLength:
    """What there is to read, for a bar that says how much is left.

    Attributes
    ----------
    total : float or None
        None where it is not known before the end, as of a compressed file.
    unit : {'s', 'B'}
        What it is counted in.
    """

    total: float | None
    unit: Literal["s", "B"]
    _last_ns: int | None = None

    @classmethod
    def of(cls, source: Source) -> Self:
        """Return the length of a source that has an end."""
        if isinstance(source, RecordedSource):
            return cls(source.recording.duration_s or None, "s")
        return cls(source.size if isinstance(source, FileSource) else None, "B")

    def of_buffer(self, buffer: Buffer) -> float:
        """Return how much of it a piece is, given the one before."""
        if self.unit == "B":
            return float(len(buffer.data))
        if not len(buffer.host_ns):
            return 0.0
        first = int(buffer.host_ns[0]) if self._last_ns is None else self._last_ns
        self._last_ns = int(buffer.host_ns[-1])
        return max(0.0, (self._last_ns - first) * 1e-9)


class _End:
    """Says that nothing follows, and why."""

    def __init__(self, error: BaseException | None = None) -> None:
        self.error = error


def prefetch(items: Iterable[Item], depth: int = 2) -> Iterator[Item]:
    """Yield items that a thread takes from an iterable, `depth` of them before they are asked for.

    An error of the iterable is raised here, in its place. When the consumer stops the thread
    ends at its next item.

    Examples
    --------
    >>> list(prefetch(range(5)))
    [0, 1, 2, 3, 4]
    """
    ready: queue.Queue[Item | _End] = queue.Queue(depth)
    given_up = threading.Event()

    def put(item: Item | _End) -> None:
        while not given_up.is_set():
            try:
                return ready.put(item, timeout=0.1)
            except queue.Full:
                continue

    def produce() -> None:
        error: BaseException | None = None
        try:
            for item in items:
                put(item)
                if given_up.is_set():
                    return
        except BaseException as raised:
            error = raised
        put(_End(error))

    thread = threading.Thread(target=produce, name="prefetch", daemon=True)
    thread.start()
    try:
        while not isinstance(item := ready.get(), _End):
            yield item
        if item.error is not None:
            raise item.error
    finally:
        given_up.set()
        thread.join()
