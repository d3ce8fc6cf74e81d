"""A white level that is not one level: bursts of activity around a quiet bench."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Make the white noise `ratio` times as large within each of `intervals` stretches of time.

    The record is cut into as many equal parts; each has one noisy stretch of `length` (a quarter of
    the part when 0) at a random place. AVAR keeps its slope of -1 and shows the mean square.
    """
    count = int(parameters["intervals"])
    part = max(setting.duration_s - setting.onset_s, 0.0) / max(count, 1)
    length = min(parameters["length"] or part / 4.0, part)
    offsets = setting.rng.uniform(0.0, part - length, count)
    begins = setting.onset_s + part * np.arange(count) + offsets
    gain = parameters["ratio"] - 1.0

    def apply(values: NDArray[Any], scene: Scene) -> None:
        inside = np.searchsorted(begins, scene.time_s, side="right") - np.searchsorted(
            begins + length, scene.time_s, side="right"
        )
        values *= 1.0 + gain * inside

    return apply


KIND = EffectKind(
    name="variance_change",
    summary="stretches of time in which the white noise is larger",
    stage="white",
    parameters={
        "intervals": Parameter("1", "number of noisy stretches", above=0.0),
        "ratio": Parameter("1", "of the standard deviations", default=2.0, above=0.0),
        "length": Parameter("s", "of each; 0 for a quarter of its share", 0.0, least=0.0),
    },
    set_up=_set_up,
)
