"""What the reader of a result must know of a run and of each axis, one sentence each."""

from __future__ import annotations

from allanscope.analysis.analyser import Analyser, StreamState
from allanscope.analysis.result import Rate
from allanscope.clock import DISAGREEMENT
from allanscope.noise import advice
from allanscope.quantities import number
from allanscope.samples import unit_of

__all__ = ["axis_remarks", "run_remarks"]


def axis_remarks(state: StreamState, column: int) -> tuple[str, ...]:
    """Return what stands out in the samples of one axis."""
    out = []
    if state.samples and state.lowest[column] == state.highest[column]:
        unit = unit_of(state.info.axes[column])
        step = state.info.scale[column] if state.counted else 0.0
        words = advice(unit, step, constant=True)
        held = "counts" if state.counted else unit
        out.append(f"every sample is {state.lowest[column]:g} {held}: {words}")
    if state.saturated[column]:
        out.append(f"saturated: {state.saturated[column]} samples at the end of the range")
    return tuple(out)


def run_remarks(analyser: Analyser, state: StreamState, rate: Rate) -> tuple[str, ...]:
    """Return what stands out in the run as a whole."""
    out = list(state.padding.remarks(rate.best_hz or 1.0))
    others = [one for one in analyser.configurations if one is not state and one.samples]
    if others:
        out.append(
            f"The device changed its configuration: {sum(one.samples for one in others)} samples "
            "of other configurations are recorded but not part of this result."
        )
    if state.watch_failure:
        out.append(
            f"The watch for events failed ({state.watch_failure}): later ones were not looked for; "
            "please report it."
        )
    if rate.measured_hz is None:
        out.append("The true sample rate is not known: averaging times use the nominal rate.")
    apart_ppm = rate.device_against_host_ppm
    if rate.source == "device" and apart_ppm is not None and abs(apart_ppm) > 1e6 * DISAGREEMENT:
        out.append(
            f"The clocks of the device and the computer differ by {number(abs(apart_ppm), 2)} ppm, "
            "as when the computer reads late: the rate is by the device's clock."
        )
    return (*out, *dict.fromkeys(analyser.errors[-5:]))
