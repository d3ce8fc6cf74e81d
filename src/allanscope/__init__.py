"""allanscope: live Allan-variance monitor for LSM6DS3H / LSM6DSL / LSM6DSM inertial sensors.

What a program of one's own needs::

    deviation(x, rate=104.0, kind="oadev")         one curve of one array
    bank = AllanBank(rate=104.0, axes=6)           every curve of a stream, in constant memory
    with open_stream("auto") as stream: ...        a device's samples as they come
    with live("auto") as session: session.result   a device measured in the background
    analyse("session.mcap").to_dict()              the whole result, closed loop included
    Simulator(rate=104.0, seed=1).read(1000)       samples of which the truth is known

A name is imported when it is first used: numerical code is not light.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.allan import AllanBank, CurveChoices, Deviation, deviation
    from allanscope.analysis import SCHEMA, Analysis
    from allanscope.errors import (
        AllanscopeError,
        CheckFailed,
        DeviceError,
        ExitCode,
        InputError,
        UsageError,
    )
    from allanscope.pipeline import LiveSession, Stream, analyse, live, open_stream
    from allanscope.recording import Recording
    from allanscope.samples import AXES, Block, Gap, StreamInfo, Ticks
    from allanscope.simulator import Simulator

    __version__: str

_HOMES = {
    "AXES": "samples",
    "AllanBank": "allan",
    "AllanscopeError": "errors",
    "Analysis": "analysis",
    "Block": "samples",
    "CheckFailed": "errors",
    "CurveChoices": "allan",
    "Deviation": "allan",
    "DeviceError": "errors",
    "ExitCode": "errors",
    "Gap": "samples",
    "InputError": "errors",
    "LiveSession": "pipeline",
    "Recording": "recording",
    "SCHEMA": "analysis",
    "Simulator": "simulator",
    "Stream": "pipeline",
    "StreamInfo": "samples",
    "Ticks": "samples",
    "UsageError": "errors",
    "analyse": "pipeline",
    "deviation": "allan",
    "live": "pipeline",
    "open_stream": "pipeline",
}

__all__ = [
    "AXES",
    "SCHEMA",
    "AllanBank",
    "AllanscopeError",
    "Analysis",
    "Block",
    "CheckFailed",
    "CurveChoices",
    "Deviation",
    "DeviceError",
    "ExitCode",
    "Gap",
    "InputError",
    "LiveSession",
    "Recording",
    "Simulator",
    "Stream",
    "StreamInfo",
    "Ticks",
    "UsageError",
    "analyse",
    "deviation",
    "live",
    "open_stream",
]

_find, __dir__ = lazily(__name__, _HOMES)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("allanscope")
    return _find(name)
