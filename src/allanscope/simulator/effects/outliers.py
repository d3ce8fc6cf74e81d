"""Outliers: isolated samples far outside the distribution of the rest, as of a mixed read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]

SIGMAS = 20.0


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Displace `count` single samples, spread at random over the record, by +-size.

    Without a size: 20 standard deviations of the white noise, at least 20 counts.
    """
    rng, count = setting.rng, int(parameters["count"])
    usual = SIGMAS * max(setting.white_sigma, setting.lsb)
    size = parameters["size"] or usual
    times = rng.uniform(setting.onset_s, max(setting.duration_s, setting.onset_s), count)
    rows = np.sort(np.floor(times * setting.rate_hz).astype(np.int64))
    sizes = size * rng.choice([-1.0, 1.0], count)

    def apply(values: NDArray[Any], scene: Scene) -> None:
        here = slice(*np.searchsorted(rows, (scene.first, scene.first + len(values))))
        values[rows[here] - scene.first] += sizes[here]

    return apply


KIND = EffectKind(
    name="outliers",
    summary="isolated outliers",
    stage="signal",
    parameters={
        "count": Parameter("1", "in the whole record", above=0.0),
        "size": Parameter("axis", "0 for 20 standard deviations", default=0.0),
    },
    set_up=_set_up,
)
