"""Sensors that a driver of Linux reads (Industrial I/O), e.g. st_lsm6dsx: live and recorded.

::

    /sys/bus/iio/devices/iio:deviceN ─▶ devices  what there is, how it is set, switched on and off
    /dev/iio:deviceN, or a file      ─▶ scans    bytes to counts and times; gyroscope and
                                                 accelerometer of one moment
    IioSource                                    the same as frames of the native protocol

The kernel's own files are read, as libiio does on the machine itself; no library is needed. A
driver gives scans without saying what they mean, so that the source, and not the device, numbers
samples by their times and describes them: what is recorded can be replayed anywhere.
"""

from __future__ import annotations

from allanscope.sources.iio.devices import IioSensor, find_iio_sensors, part_name
from allanscope.sources.iio.scans import (
    AXIS_NAMES,
    TIME,
    ScanElement,
    ScanLayout,
    pair,
    period_of,
    scale_of,
)
from allanscope.sources.iio.source import IioSource

__all__ = [
    "AXIS_NAMES",
    "TIME",
    "IioSensor",
    "IioSource",
    "ScanElement",
    "ScanLayout",
    "find_iio_sensors",
    "pair",
    "part_name",
    "period_of",
    "scale_of",
]
