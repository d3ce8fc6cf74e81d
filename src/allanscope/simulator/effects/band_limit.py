"""The part's own low-pass filter: it shapes the noise floor near half the sample rate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.errors import UsageError
from allanscope.simulator.effects import Apply, EffectKind, Parameter, Scene, Setting

__all__ = ["KIND"]


def _set_up(parameters: Mapping[str, float], setting: Setting) -> Apply:
    """Filter by a second-order Butterworth low-pass, -3 dB at the cutoff (bilinear, prewarped).

    It acts on the sensor's own noise (N, B, K) and on nothing that is added as an effect, so that
    an amplitude is always that of the record. N is the level below the cutoff.
    """
    from scipy.signal import butter, sosfilt

    cutoff = parameters["cutoff"]
    if cutoff >= setting.rate_hz / 2.0:
        raise UsageError(
            f"effect band_limit: a cutoff of {cutoff:g} Hz must be below half the sample rate, "
            f"{setting.rate_hz / 2.0:g} Hz"
        )
    sections = butter(2, cutoff, fs=setting.rate_hz, output="sos")
    carry = np.zeros((len(sections), 2))

    def apply(values: NDArray[Any], scene: Scene) -> None:
        values[:], carry[:] = sosfilt(sections, values, zi=carry)

    return apply


KIND = EffectKind(
    name="band_limit",
    summary="low-pass of the noise floor",
    stage="noise",
    parameters={"cutoff": Parameter("Hz", "-3 dB", above=0.0)},
    set_up=_set_up,
)
