"""Folders of libiio: what ``iio_readdev`` wrote of a gyroscope and an accelerometer.

::

    context.xml         what iio_genxml says: of each device its channels, types and scales
    lsm6dsm_gyro.bin    what iio_readdev lsm6dsm_gyro gives: scans of all channels of that device
    lsm6dsm_accel.bin   the same of the other one

Scans have no head: which channels they have is in the XML. All channels of a device are expected,
as ``iio_readdev`` without names of channels records them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from allanscope.parts import PARTS
from allanscope.pipeline.columns import Columns
from allanscope.pipeline.table_files import MOST_BYTES, TableFile
from allanscope.samples import AXES
from allanscope.sources import (
    AXIS_NAMES,
    TIME,
    ScanElement,
    ScanLayout,
    pair,
    part_name,
    period_of,
    scale_of,
)

__all__ = ["CONTEXT", "read"]

CONTEXT = "context.xml"
MOST_XML_BYTES = 4 << 20
_MOSTLY = 0.9


@dataclass(frozen=True, slots=True)
class _Device:
    """A device of the XML, with the file that has its scans."""

    name: str
    file: Path
    layout: ScanLayout
    per_count: dict[str, float]


@dataclass(frozen=True, slots=True)
class _Samples:
    """Times in ns, shape (n,), and counts, shape (n, k), of one device."""

    times: NDArray[np.int64]
    counts: NDArray[np.int64]


def read(path: Path, stream: str = "") -> TableFile:
    """Return the samples of the part `stream`, or of the first that has a gyroscope."""
    parts: dict[str, list[_Device]] = {}
    for device in _devices(path):
        parts.setdefault(part_name(device.name).lower(), []).append(device)
    if not parts:
        raise ValueError(
            f"no file with the scans of a device that {CONTEXT} has; call it as the device, for "
            "instance lsm6dsm_gyro.bin"
        )
    if stream and stream.lower() not in parts:
        raise ValueError(f"no sensor {stream}; there is {' '.join(parts)}")
    chosen = stream.lower() or max(
        parts, key=lambda one: any("gx" in device.layout.axes for device in parts[one])
    )
    remarks = []
    if others := [one for one in parts if one != chosen]:
        remarks.append(f"the part is {chosen}; --stream selects another: {' '.join(others)}")
    part = chosen.upper() if chosen.upper() in PARTS else ""
    devices = sorted(parts[chosen], key=lambda one: "gx" not in one.layout.axes)
    found = [_samples(one) for one in devices]
    if len(found) > 1:
        mine, partner = pair(found[0].times, found[1].times, period_of(found[0].times))
        both = [(found[0], mine), (found[1], partner)]
        found = [_Samples(one.times[rows], one.counts[rows]) for one, rows in both]
    columns, scales = {}, {}
    for device, samples in zip(devices, found, strict=False):
        for i, axis in enumerate(device.layout.axes):
            columns[axis] = samples.counts[:, i].astype(np.int32)
            scales[axis] = scale_of(axis, device.per_count[axis], part)
    axes = {axis: columns[axis] for axis in AXES if axis in columns}
    time_s = (found[0].times - found[0].times[:1]).astype(np.float64) * 1e-9
    table = Columns(axes, dict.fromkeys(axes, "lsb"), time_s, None, scales, tuple(remarks))
    return TableFile(table, "iio", part=part)


def _devices(path: Path) -> list[_Device]:
    """Return the devices of the XML that have a file in the folder."""
    text = (path / CONTEXT).read_bytes()[: MOST_XML_BYTES + 1]
    if len(text) > MOST_XML_BYTES or b"<!ENTITY" in text:
        raise ValueError(f"{CONTEXT} is not what iio_genxml writes")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"{CONTEXT}: {error}") from None
    files = {one.stem.lower(): one for one in sorted(path.iterdir()) if one.suffix != ".xml"}
    devices = []
    for node in root.iter("device"):
        names = (node.get("name", ""), node.get("id", ""))
        file = next((files[one.lower()] for one in names if one and one.lower() in files), None)
        device = _device(node, file) if file is not None else None
        if device is not None:
            devices.append(device)
    return devices


def _device(node: ElementTree.Element, file: Path) -> _Device | None:
    """Return a device, None for what is neither gyroscope nor accelerometer."""
    elements, per_count = [], {}
    for channel in node.iter("channel"):
        scan = channel.find("scan-element")
        if scan is None or channel.get("type") != "input":
            continue
        name = channel.get("id", "")
        elements.append(ScanElement.of(name, int(scan.get("index", "0")), scan.get("format", "")))
        if (scale := _scale(channel, scan)) is not None:
            per_count[name] = scale
    layout = ScanLayout(tuple(sorted(elements, key=lambda one: one.index)))
    if not layout.axes:
        return None
    shown = node.get("name", "") or node.get("id", "")
    if TIME not in [one.name for one in elements]:
        raise ValueError(f"{shown} has no {TIME}: nothing tells its rate, nor what is missing")
    names = [one.name for one in layout.elements if one.name in AXIS_NAMES]
    missing = [name for name in names if name not in per_count]
    if missing:
        raise ValueError(f"{CONTEXT} has no scale of {missing[0]} of {shown}")
    by_axis = {ours: per_count[name] for ours, name in zip(layout.axes, names, strict=True)}
    return _Device(shown, file, layout, by_axis)


def _scale(channel: ElementTree.Element, scan: ElementTree.Element) -> float | None:
    """Return what a count is, in rad/s or m/s^2; None where nothing says it."""
    texts = [scan.get("scale")]
    texts += [one.get("value") for one in channel.iter("attribute") if one.get("name") == "scale"]
    for text in texts:
        if text is not None and 0.0 < float(text) < 1e3:
            return float(text)
    return None


def _samples(device: _Device) -> _Samples:
    """Return what the file of a device holds."""
    size = device.file.stat().st_size
    scan = device.layout.dtype
    if size > MOST_BYTES:
        raise ValueError(f"{device.file.name} is larger than {MOST_BYTES >> 30} GiB")
    scans = np.fromfile(device.file, scan, size // scan.itemsize)
    times = device.layout.times_ns(scans)
    if len(times) < 2 or (np.diff(times) > 0).mean() < _MOSTLY:
        raise ValueError(
            f"{device.file.name} does not hold scans of {scan.itemsize} bytes whose times go up; "
            f"record all channels of {device.name}"
        )
    return _Samples(times, device.layout.counts(scans))
