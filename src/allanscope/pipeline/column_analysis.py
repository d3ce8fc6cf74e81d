"""The analysis of columns, wherever they came from: arrays of Python, an .npz file, Parquet."""

from __future__ import annotations

from collections.abc import Mapping

from allanscope.analysis import Analyser, Analysis, summarise
from allanscope.pipeline.analyse import full_settings
from allanscope.pipeline.arrays import events_of_columns, words_of
from allanscope.pipeline.columns import Columns, with_guesses
from allanscope.pipeline.settings import DeviceSettings
from allanscope.wire import LinkStats

__all__ = ["analyse_columns"]


def analyse_columns(columns: Columns, device: DeviceSettings, facts: Mapping[str, str]) -> Analysis:
    """Return the full result.

    Parameters
    ----------
    columns : Columns
        Samples, times and temperatures.
    device : DeviceSettings
        What the user said.
    facts : mapping
        Where they came from.

    Raises
    ------
    ValueError
        For samples that make no sense.
    """
    columns = with_guesses(columns)
    analyser = Analyser(full_settings(device.part))
    for event in events_of_columns(columns, device):
        analyser.take(event)
    state = analyser.state
    if state is None or not state.samples:
        raise ValueError("the arrays hold no samples; nothing to analyse")
    known = {"wire": state.info.wire, **facts, "units": words_of(columns, state.info)}
    link = LinkStats(samples=state.samples, lost_samples=state.lost)
    return summarise(analyser, link, "full", known)
