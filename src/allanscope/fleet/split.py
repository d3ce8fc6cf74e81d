"""One recording on several workers: a first pass, parts in parallel, and the join.

::

    first pass   the whole recording, decoded once: history, clock, temperature, losses, and at each
       │         cut the decoder as it is there and the last samples before (the halo)
       ├──▶ part 1   decode on from the cut ─▶ deviations and spectrum of this part ─┐
       ├──▶ part 2   ...                                                             ├─▶ join
       └──────────────────────────────────────────────────────────────────────────── ┘   the result

A decoder cannot begin in the middle: it must know the descriptor, the count of samples, the time
that has wrapped. So one worker decodes everything, which is the smaller part of the work, and takes
along all that is cheap or that has no exact way of being split: the series that the closed loop
needs is that of a single run. The sums, which are the larger part, are done by the parts from exact
copies of the decoder; see `allanscope.allan.shard` for why the join is the result of one pass,
integers exactly and sums to rounding. What does not fit this plan (a device that changed its
configuration, a recording too short for it) is analysed in one pass by whoever joins.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from allanscope.allan import AllanBank
from allanscope.allan.archive import ROWS
from allanscope.analysis import Analyser
from allanscope.fleet.inputs import RecordingInput
from allanscope.fleet.outcome import Outcome
from allanscope.fleet.part_sums import NullSum, PartSums, TailBuffer
from allanscope.fleet.worker_tasks import (
    analyse_recording,
    failure,
    new_analyser,
    outcome_of,
    recorded_events,
)
from allanscope.pipeline import Decoding, DeviceSettings, recorded_settings
from allanscope.recording import Fingerprint, Recording
from allanscope.samples import StreamInfo
from allanscope.spectrum import SpectrumBank

if TYPE_CHECKING:
    from distributed import Client, Future

    from allanscope.fleet.cluster import WorkerPool

__all__ = ["FirstPass", "SplitPoint", "first_pass", "join", "submit_split", "sum_part"]


@dataclass(frozen=True, slots=True)
class SplitPoint:
    """Where a part begins.

    Attributes
    ----------
    decoding : bytes
        The decoder, pickled, as it is after all reads before.
    after : int
        Number that the next read has.
    anchor : ndarray, shape (axes,), or None
        First sample of the run; None when there was none yet.
    taken : int
        Samples of the open segment so far.
    recent : ndarray, shape (n, axes)
        The last of them: from `ALIGNED` before the last multiple of `ALIGNED` on.
    """

    decoding: bytes
    after: int
    anchor: NDArray[np.float64] | None
    taken: int
    recent: NDArray[np.generic]


@dataclass(slots=True)
class FirstPass:
    """What is known after one worker has read everything.

    Attributes
    ----------
    outcome : Outcome or None
        Set when the recording cannot be read.
    cuts : tuple of SplitPoint
        One for each part; empty where the recording is not to be split.
    analyser : Analyser or None
        Everything but the sums of deviations and spectrum.
    """

    item: RecordingInput
    outcome: Outcome | None = None
    cuts: tuple[SplitPoint, ...] = ()
    analyser: Analyser | None = None
    decoding: Decoding | None = None
    sha256: str = ""


def submit_split(
    client: Client | WorkerPool, item: RecordingInput, device: DeviceSettings, parts: int
) -> Future:
    """Hand out one recording in parts; the future is an `Outcome`, as of a whole one."""
    seen = client.submit(first_pass, item, device, parts, pure=False)
    sums = [
        client.submit(sum_part, item, client.submit(_cut, seen, number, pure=False), number, parts)
        for number in range(parts)
    ]
    return client.submit(join, seen, sums, device, pure=False)


def _cut(seen: FirstPass, number: int) -> SplitPoint | None:
    """Take one cut out, so that a part is not sent the series of the whole."""
    return seen.cuts[number] if seen.cuts else None


def first_pass(item: RecordingInput, device: DeviceSettings, parts: int) -> FirstPass:
    """Read a recording once and find where its parts begin."""
    try:
        return _first_pass(item, device, parts)
    except Exception as error:
        return FirstPass(item, failure(item, error))


def sum_part(
    item: RecordingInput, cut: SplitPoint | None, number: int, parts: int
) -> PartSums | None:
    """Sum up one part; nothing for a recording that is not to be split."""
    if cut is None:
        return None
    decoding: Decoding = pickle.loads(cut.decoding)
    part = PartSums(cut.anchor, cut.taken, cut.recent)
    recording = Recording(item.open_path()).part(number, parts)
    for event in recorded_events(recording, decoding, cut.after, last=number == parts - 1):
        part.feed(event)
    part.finish(last=number == parts - 1)
    return part


def join(seen: FirstPass, sums: list[PartSums | None], device: DeviceSettings) -> Outcome:
    """Return the outcome of a recording from its first pass and its parts."""
    item = seen.item
    if seen.outcome is not None:
        return seen.outcome
    if seen.analyser is None or seen.decoding is None or not seen.cuts:
        return analyse_recording(item, device)
    try:
        state = seen.analyser.configurations[0]
        axes = len(state.info.axes)
        rate_hz = state.info.nominal_hz or 1.0
        anchor = cast(TailBuffer, state.bank).anchor
        bank = AllanBank(rate_hz, axes, seen.analyser.settings.per_octave, anchor=anchor)
        spectrum = SpectrumBank(rate_hz, axes, anchor=anchor)
        for part in sums:
            assert part is not None
            part.join_to(bank, spectrum)
        state.bank, state.spectrum = bank, spectrum
        recording = Recording(item.open_path())
        return outcome_of(item, recording, seen.sha256, seen.analyser, seen.decoding)
    except Exception as error:
        return failure(item, error)


def _first_pass(item: RecordingInput, device: DeviceSettings, parts: int) -> FirstPass:
    recording = Recording(item.open_path())
    settings = recorded_settings(recording, device)
    decoding = Decoding(settings.for_wire(), settings.wire)
    analyser = new_analyser(settings)
    fingerprint = Fingerprint()
    cuts = []
    after = 0
    for number in range(parts):
        cuts.append(_split_point(analyser, decoding, after))
        part = recording.part(number, parts)
        last = number == parts - 1
        for event in recorded_events(part, decoding, after, last=last, fingerprint=fingerprint):
            analyser.feed(event)
            if isinstance(event, StreamInfo):
                _disable_sums(analyser)
        after = part.next_read(after)
    found = FirstPass(item, None, tuple(cuts), analyser, decoding, fingerprint.hexdigest())
    if analyser.state is not None:
        analyser.state.settle()
    if not _is_splittable(analyser):
        return FirstPass(item)
    return found


def _disable_sums(analyser: Analyser) -> None:
    state = analyser.state
    assert state is not None
    if isinstance(state.bank, AllanBank):
        state.bank = cast(AllanBank, TailBuffer(len(state.info.axes)))
        state.spectrum = cast(SpectrumBank, NullSum())


def _split_point(analyser: Analyser, decoding: Decoding, after: int) -> SplitPoint:
    held = pickle.dumps(decoding)
    if analyser.state is None:
        return SplitPoint(held, after, None, 0, np.empty((0, 0)))
    analyser.state.settle()
    analyser.state.release_padding()
    tail = cast(TailBuffer, analyser.state.bank)
    return SplitPoint(held, after, tail.anchor, tail.taken, tail.recent())


def _is_splittable(analyser: Analyser) -> bool:
    """Whether the join is the result of one pass.

    It needs one configuration, rows as long as ours, and no padding that only one pass leaves out.
    """
    if len(analyser.configurations) != 1 or analyser.configurations[0].padding.is_padding:
        return False
    tail = cast(TailBuffer, analyser.configurations[0].bank)
    return tail.rows_of_half_segment() > ROWS
