"""The measured sample rate in the place of the claimed one, for those who only see the samples."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from allanscope.clock import Clock
from allanscope.samples import Block, Event, Gap, StreamInfo

__all__ = ["at_rates", "measured_rates"]

Configuration = tuple[tuple[str, ...], tuple[float, ...], float]
"""As `StreamInfo.configuration` has it."""


def measured_rates(events: Iterable[Event]) -> dict[Configuration, float]:
    """Return the rate in Hz of each configuration of a stream whose times tell it.

    Parameters
    ----------
    events : iterable of Event
        The whole stream.

    Examples
    --------
    Blocks of a device that claims 100 Hz and stamps its samples 96 times a second:

    >>> import numpy as np
    >>> from allanscope.samples import Ticks
    >>> info = StreamInfo(("gx",), (1.0,), nominal_hz=100.0, device_clock=True)
    >>> row, unknown = np.arange(1000), np.full(1000, np.nan)
    >>> block = Block(0, np.zeros((1000, 1), np.int16), Ticks(row, row / 96.0, unknown, unknown))
    >>> rates = measured_rates([info, block])
    >>> [round(told.nominal_hz, 3) for told in at_rates([info], rates)]
    [96.0]
    """
    clocks: dict[Configuration, Clock] = {}
    clock: Clock | None = None
    for event in events:
        if isinstance(event, StreamInfo):
            clock = clocks.setdefault(event.configuration, Clock.of(event))
        elif isinstance(event, Gap) and clock is not None:
            clock.gap(event)
        elif isinstance(event, Block) and clock is not None:
            clock.update(event.index, event.ticks)
    fits = {configuration: clock.rate() for configuration, clock in clocks.items()}
    return {configuration: fit.hz for configuration, fit in fits.items() if fit.is_measured}


def at_rates(events: Iterable[Event], rates: Mapping[Configuration, float]) -> Iterator[Event]:
    """Yield the same stream with the measured rate, which nobody claims, where there is one."""
    for event in events:
        if isinstance(event, StreamInfo) and event.configuration in rates:
            yield replace(event, nominal_hz=rates[event.configuration], rate_claimed=False)
        else:
            yield event
