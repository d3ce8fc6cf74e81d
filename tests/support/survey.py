"""What a recorded session holds, stretch by stretch, and what its device knows to be missing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from allanscope.pipeline import Decoding
from allanscope.recording import Recording
from allanscope.samples import Block, Gap, StreamInfo
from allanscope.wire import WireSettings


@dataclass
class Stretch:
    """What came under one StreamInfo: where it begins and ends, and what came of it."""

    info: StreamInfo
    first: int = -1
    stop: int = -1
    received: int = 0
    lost: int = 0
    unknown: int = 0


def survey(folder: Path) -> list[Stretch]:
    """Decode what a session holds."""
    decoding, stretches = Decoding(WireSettings()), []
    for chunk in Recording(folder).chunks():
        for event in decoding.feed(chunk):
            match event:
                case StreamInfo():
                    stretches.append(Stretch(event))
                case Block():
                    here = stretches[-1]
                    here.first = event.index if here.first < 0 else here.first
                    here.stop = event.index + len(event)
                    here.received += len(event)
                case Gap(lost=None):
                    stretches[-1].unknown += 1
                case Gap(lost=lost):
                    stretches[-1].lost += lost or 0
    return stretches


def missing(ledger: dict[str, Any], stretch: Stretch) -> int:
    """Return how many samples of a stretch the device knows not to have arrived."""
    return sum(
        max(0, min(first + count, stretch.stop) - max(first, stretch.first))
        for epoch, first, count, _ in ledger["losses"]
        if epoch == stretch.info.epoch
    )
