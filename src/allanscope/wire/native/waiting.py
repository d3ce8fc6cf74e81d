"""Data frames of an epoch that nobody has described yet."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from allanscope.samples import Notice
from allanscope.wire.native.run import Run

__all__ = ["Waiting"]

_MOST_FRAMES = 1024
_ASK_EVERY = 64


class Waiting:
    """Keeps about two seconds of frames, and asks for the descriptor until it comes."""

    def __init__(self) -> None:
        self._runs: deque[tuple[Run, bool]] = deque()
        self._asked = 0

    def add(self, run: Run, frames_missing: bool) -> Iterator[Notice]:
        """Keep a run, the oldest frames making room, and yield what to ask for."""
        for number in range(len(run)):
            if self._asked % _ASK_EVERY == 0:
                yield Notice(
                    "status",
                    f"waiting for the descriptor of epoch {run.epoch:#06x}",
                    {"wanted": "descriptor", "epoch": run.epoch},
                )
            self._asked += 1
            frame = run.frames(number, number + 1)
            # Copies, because a slice would keep all that was read with it.
            frame = Run(frame.headers.copy(), frame.samples.copy(), frame.host_s.copy())
            self._runs.append((frame, frames_missing and number == 0))
            if len(self._runs) > _MOST_FRAMES:
                self._runs.popleft()

    def release(self, epoch: int | None = None) -> list[tuple[Run, bool]]:
        """Return the frames of an epoch and forget all others."""
        runs, self._runs = self._runs, deque()
        self._asked = 0
        return [(run, missing) for run, missing in runs if run.epoch == epoch]

    @property
    def samples(self) -> int:
        """Number of samples that wait."""
        return sum(len(run.samples) for run, _ in self._runs)
