"""What a host may set: sample rate, full scales, axes."""

from __future__ import annotations

from allanscope.errors import UsageError
from allanscope.parts import part_named
from allanscope.simulator.simulator import Simulator
from allanscope.wire import Command

__all__ = ["reconfigure"]

SETTINGS = {"rate_hz": "rate", "gyro_fs": "gyro_fs", "accel_fs": "accel_fs", "axes": "axes"}
NEAREST = 0.05
"""A rate is taken for the nearest that the part has when it is within this share of it."""


def reconfigure(sensor: Simulator, command: Command) -> Simulator | None:
    """Return the sensor as a command wants it: `set`, and in some formats `start`.

    Returns
    -------
    Simulator or None
        The same object when nothing changes; None when the part cannot do it.

    Examples
    --------
    >>> sensor = Simulator(rate=104.0)
    >>> reconfigure(sensor, Command("set", fields={"rate_hz": 210.0})).info.nominal_hz
    208.0
    >>> reconfigure(sensor, Command("set", fields={"rate_hz": 150.0})) is None
    True
    >>> reconfigure(sensor, Command("set", fields={"rate_hz": 104.0})) is sensor
    True
    """
    wanted = {SETTINGS[name]: value for name, value in command.fields.items() if name in SETTINGS}
    if not wanted:
        return sensor
    if "rate" in wanted:
        rates = (sensor.info.nominal_hz, *part_named(sensor.info.part).rates_hz)
        nearest = min(rates, key=lambda rate: abs(rate - wanted["rate"]))
        if not abs(nearest - wanted["rate"]) <= NEAREST * nearest:
            return None
        wanted["rate"] = nearest
    try:
        changed = sensor.reconfigured(**wanted)
    except UsageError:
        return None
    same = changed.info == sensor.info
    return sensor if same else changed
