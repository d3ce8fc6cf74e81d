"""Recovery: everything of a damaged session that can still be read, in one sound file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from allanscope.atomic_write import atomic_write
from allanscope.errors import InputError, UsageError
from allanscope.quantities import count, duration
from allanscope.recording.layout import CHANNELS, RX
from allanscope.recording.outline import TRUNCATED, Damage
from allanscope.recording.reader import Recording
from allanscope.recording.segment import COMMIT_BYTES, Segment

__all__ = ["RecoveryReport", "recover"]


@dataclass(slots=True)
class RecoveryReport:
    """What was saved, and exactly what was not.

    Attributes
    ----------
    out : Path
        The new file.
    reads, bytes : int
        Reads of the source that were saved, and the bytes in them.
    lost_reads : int
        Reads that are missing between saved ones, by their numbers.
    lost_s : float
        Time between the neighbours of every gap, in seconds: no more than that is missing.
    damage : list of Damage
        Where the files could not be read, and how many bytes of them that is.
    """

    out: Path
    reads: int = 0
    bytes: int = 0
    lost_reads: int = 0
    lost_s: float = 0.0
    damage: list[Damage] = field(default_factory=list)

    def __str__(self) -> str:
        saved = f"Saved: {self.out}: {count(self.reads)} reads, {count(self.bytes)} bytes"
        if not self.lost_reads and not self.damage:
            return f"{saved}; lost: none"
        reads = f"{count(self.lost_reads)} reads, " if self.lost_reads else ""
        unreadable = count(sum(one.length for one in self.damage))
        return "\n".join(
            [
                saved,
                f"Lost: {reads}at most {duration(self.lost_s)}",
                f"Unreadable: {unreadable} bytes",
                *(f"  {one}" for one in self.damage),
            ]
        )


def recover(
    damaged: Path, out: Path, advance: Callable[[float], None] = lambda _: None
) -> RecoveryReport:
    """Save all that can be read of a session, corrupt chunks skipped, into one new file.

    Times, numbers and order stay as they were, so that a replay of what was saved gives the same
    samples and knows of every gap. The damaged files are only read.

    Parameters
    ----------
    damaged : Path
        A file, the first file of a session, or its folder.
    out : Path
        The file to write; it appears, whole, at the very end.
    advance : callable, optional
        Told how many of the recording's `unpacked_bytes` were read since the last time.

    Raises
    ------
    InputError
        If nothing can be read.
    UsageError
        If `out` exists or cannot be written.
    """
    recording = Recording(damaged)
    if out.exists():
        raise UsageError(
            f"{out} exists; name a file that does not, the damaged one is kept as it is"
        )
    report = RecoveryReport(out)
    with atomic_write(out) as part:
        metadata = {**recording.metadata, "recovered_from": str(damaged)}
        _copy(recording, part, metadata, report, advance)
        if not report.reads:
            raise InputError(f"{damaged} has no readable data")
    report.damage = recording.damage
    report.lost_s += sum(one.seconds or 0.0 for one in report.damage if one.what == TRUNCATED)
    return report


def _copy(
    recording: Recording,
    part: Path,
    metadata: Mapping[str, str],
    report: RecoveryReport,
    advance: Callable[[float], None],
) -> None:
    """Copy message by message, and count what is missing between the reads."""
    segment = Segment(part, metadata)
    with closing(segment):
        expected, last_ns = 0, 0
        for topic, sequence, epoch_ns, host_ns, data in _messages(recording, advance):
            segment.add(topic, sequence, epoch_ns, host_ns, data)
            if segment.pending > COMMIT_BYTES:
                segment.commit()
            if topic != RX:
                continue
            report.reads += 1
            report.bytes += len(data)
            if sequence > expected > 0:
                report.lost_reads += sequence - expected
                report.lost_s += (epoch_ns - last_ns) * 1e-9
            expected, last_ns = sequence + 1, epoch_ns


def _messages(
    recording: Recording, advance: Callable[[float], None]
) -> Iterator[tuple[str, int, int, int, bytes]]:
    for data, messages in recording.intact_chunks():
        advance(len(data))
        for topic, sequence, epoch_ns, host_ns, start, stop in messages:
            if topic in CHANNELS:
                yield topic, sequence, epoch_ns, host_ns, data[start:stop]
