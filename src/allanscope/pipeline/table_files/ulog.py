"""Logs of PX4 (ULog), as pyulog reads them: one gyroscope with its accelerometer.

::

    sensor_combined    timestamp, gyro_rad[3], accelerometer_m_s2[3]    what the estimator takes
    sensor_gyro        timestamp_sample or timestamp, x y z in rad/s    each sensor has its own,
    sensor_accel       the same in m/s^2                                numbered from 0

The topic with most rows is taken. A gyroscope gets the accelerometer of its number if this has the
same times: of other times it is no column of the same table.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.errors import UsageError
from allanscope.pipeline.columns import Columns
from allanscope.pipeline.table_files import MOST_BYTES, TableFile
from allanscope.sources import pair, period_of

__all__ = ["read"]

TOPICS = {
    "sensor_combined": {
        **{f"g{axis}": f"gyro_rad[{i}]" for i, axis in enumerate("xyz")},
        **{f"a{axis}": f"accelerometer_m_s2[{i}]" for i, axis in enumerate("xyz")},
    },
    "sensor_gyro": {f"g{axis}": axis for axis in "xyz"},
    "sensor_accel": {f"a{axis}": axis for axis in "xyz"},
}
"""Axes and the fields that have them."""
_MOSTLY = 0.8
"""Share of rows that two topics must have in common."""
_NS = 1000


def read(path: Path, stream: str = "") -> TableFile:
    """Return the samples of the topic `stream`, ``sensor_gyro 1`` for instance."""
    try:
        from pyulog import ULog
    except ImportError:
        raise UsageError("logs of PX4 need pyulog: pip install pyulog") from None
    if path.stat().st_size > MOST_BYTES:
        raise ValueError(f"larger than {MOST_BYTES >> 30} GiB")
    try:
        log = ULog(str(path), list(TOPICS), True)
    except Exception as error:  # of a damaged file it raises what comes
        raise ValueError(f"pyulog cannot read it: {error or type(error).__name__}") from None
    found = {
        f"{one.name} {one.multi_id}": one.data
        for one in log.data_list
        if one.name in TOPICS and set(TOPICS[one.name].values()) <= set(one.data)
    }
    if not found:
        raise ValueError(f"no topic of {' '.join(TOPICS)}")
    wanted = stream if " " in stream else f"{stream} 0"
    if stream and wanted not in found:
        raise ValueError(f"no topic {stream}; there is {', '.join(found)}")
    chosen = wanted if stream else max(found, key=lambda one: _rank(one, found[one]))
    others = [one for one in found if one != chosen]
    remarks = [f"the topic is {chosen}"]
    times, axes = _samples(chosen, found[chosen])
    partner = chosen.replace("sensor_gyro", "sensor_accel")
    if partner != chosen and partner in found:
        others.remove(partner)
        other_times, other_axes = _samples(partner, found[partner])
        mine, theirs = pair(times, other_times, period_of(times))
        if len(mine) >= _MOSTLY * len(times):
            times = times[mine]
            axes = {name: values[mine] for name, values in axes.items()}
            axes |= {name: values[theirs] for name, values in other_axes.items()}
        else:
            remarks.append(f"{partner} is ignored: its rows have other times")
    if others:
        remarks[0] += f"; --stream selects another: {', '.join(others)}"
    units = {axis: "rad/s" if axis[0] == "g" else "m/s2" for axis in axes}
    time_s = (times - times[:1]).astype(np.float64) * 1e-9
    assumed = tuple(remarks if others or len(remarks) > 1 else ())
    return TableFile(Columns(axes, units, time_s, None, {}, assumed), "ulog")


def _rank(name: str, data: dict[str, NDArray[Any]]) -> tuple[bool, int]:
    """Return a key by which an accelerometer alone comes last, and most rows first."""
    return not name.startswith("sensor_accel"), len(data["timestamp"])


def _samples(
    name: str, data: dict[str, NDArray[Any]]
) -> tuple[NDArray[np.int64], dict[str, NDArray[np.float64]]]:
    """Return times in ns that go up, and the axes."""
    fields = TOPICS[name.partition(" ")[0]]
    # The time of the sample is nearer to the truth than that of its message, where it is filled in.
    times = np.asarray(data.get("timestamp_sample", data["timestamp"]))
    if not times.any():
        times = np.asarray(data["timestamp"])
    times = times.astype(np.int64) * _NS
    new = np.flatnonzero(np.diff(times, prepend=times[:1] - 1) > 0)
    values = {axis: np.asarray(data[field], np.float64)[new] for axis, field in fields.items()}
    return times[new], values
