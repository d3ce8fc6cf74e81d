"""Folders of HSDatalog 2 (FP-SNS-DATALOG2, STSW-SDATALOG): gyroscope and accelerometer of one part.

::

    acquisition_info.json   interface: 0 = SD card, 1 = USB
    device_config.json      of each sensor: samples_per_ts, sensitivity, ioffset, sd_dps, usb_dps
    lsm6dsv16x_gyro.dat     packets: uint32, bytes up to its end without counters; then bytes
                            of frames: samples_per_ts rows of int16 x y z, float64 time in s

A packet of the SD card has `sd_dps` bytes with its counter, one of USB `usb_dps` without. The time
of a frame is that of its last row; the first row is `ioffset` after the start. Where the counter
jumps, the rows that the missing bytes held are missing too.

Older firmware (1.1 of 2023) counts the bytes before a packet, writes `samples_per_ts` as an object
with its limits, and the sensitivity of a gyroscope in mdps.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.parts import PARTS
from allanscope.pipeline.columns import Columns
from allanscope.pipeline.table_files import MOST_BYTES, TableFile

__all__ = ["read"]

MOST_JSON_BYTES = 4 << 20
_COUNTER = 4
_WRAP = 1 << 32
_TIME = 8
_KINDS = {"gyro": ("gx", "gy", "gz"), "acc": ("ax", "ay", "az")}
_INTERFACES = (0, 1)
_LARGEST_DPS = 1.0
"""Of a count: the full scale is then 30 000 dps."""
_MOSTLY = 0.8
"""Share of rows that two sensors must have in common: fewer are not of one queue."""


@dataclass(frozen=True, slots=True)
class _Sensor:
    """What one .dat holds: rows (n, 3) of counts, their times in s, and the scale of a count."""

    counts: NDArray[np.int16]
    time_s: NDArray[np.float64]
    scale: float


def read(path: Path, stream: str = "") -> TableFile:
    """Return the samples of the part `stream`, or of the one that has most."""
    interface = _object(path / "acquisition_info.json").get("interface")
    if interface not in _INTERFACES:
        raise ValueError(f"data that came over interface {interface!r}, neither SD card nor USB")
    parts = _parts(path)
    if not parts:
        raise ValueError("no .dat of a gyroscope or an accelerometer that device_config.json names")
    if stream and stream.lower() not in parts:
        raise ValueError(f"no sensor {stream}; there is {' '.join(parts)}")
    # A part with a gyroscope comes first, then the one that has most to tell.
    chosen = stream.lower() or max(
        parts, key=lambda one: ("gyro" in parts[one], sum(_size(path, one, k) for k in parts[one]))
    )
    remarks: list[str] = []
    if others := [one for one in parts if one != chosen]:
        remarks.append(f"the part is {chosen}; --stream selects another: {' '.join(others)}")
    found = {
        kind: _sensor(path / f"{chosen}_{kind}.dat", kind, status, interface == 0, remarks)
        for kind, status in sorted(parts[chosen].items(), reverse=True)  # the gyroscope first
    }
    if len(found) == len(_KINDS):
        pair = _together(found["gyro"], found["acc"])
        if pair is None:
            del found["acc"]
            remarks.append("the accelerometer is ignored: its rows have other times")
        else:
            found["gyro"], found["acc"] = pair
    axes, scales = {}, {}
    for kind, sensor in found.items():
        for i, axis in enumerate(_KINDS[kind]):
            axes[axis], scales[axis] = sensor.counts[:, i], sensor.scale
    time_s = next(iter(found.values())).time_s
    columns = Columns(axes, dict.fromkeys(axes, "lsb"), time_s, None, scales, tuple(remarks))
    name = chosen.upper()
    return TableFile(columns, "hsdatalog", part=name if name in PARTS else "")


def _size(path: Path, part: str, kind: str) -> int:
    return (path / f"{part}_{kind}.dat").stat().st_size


def _object(path: Path) -> Mapping[str, Any]:
    """Return what a file of JSON holds."""
    if path.stat().st_size > MOST_JSON_BYTES:
        raise ValueError(f"{path.name} is larger than {MOST_JSON_BYTES} bytes")
    try:
        found = json.loads(path.read_bytes())
    except RecursionError:
        found = None
    if not isinstance(found, dict):
        raise ValueError(f"{path.name} contains no object")
    return found


def _parts(path: Path) -> dict[str, dict[str, Mapping[str, Any]]]:
    """Return what is known of each sensor, by the name of its part and its kind."""
    devices = _object(path / "device_config.json").get("devices")
    device = devices[0] if isinstance(devices, list) and devices else None
    components = device.get("components") if isinstance(device, dict) else None
    parts: dict[str, dict[str, Mapping[str, Any]]] = {}
    for component in components if isinstance(components, list) else ():
        for name, status in component.items() if isinstance(component, dict) else ():
            part, _, kind = name.lower().rpartition("_")
            plain = part.isidentifier() and kind in _KINDS and isinstance(status, dict)
            if plain and (path / f"{part}_{kind}.dat").is_file():
                parts.setdefault(part, {})[kind] = status
    return parts


def _number(status: Mapping[str, Any], name: str, low: float, high: float) -> float:
    value = status.get(name)
    if isinstance(value, dict):  # with the limits of what may be set
        value = value.get("val")
    if not isinstance(value, int | float) or not low <= value <= high:
        raise ValueError(f"device_config.json: {name} is {value!r}")
    return float(value)


def _sensor(
    file: Path, kind: str, status: Mapping[str, Any], on_card: bool, remarks: list[str]
) -> _Sensor:
    """Return the samples of one .dat; add to `remarks` what was assumed."""
    if status.get("data_type") != "int16" or status.get("dim") != 3:
        raise ValueError(f"{file.name}: not three axes of int16")
    if file.stat().st_size > MOST_BYTES:
        raise ValueError(f"{file.name} is larger than {MOST_BYTES >> 30} GiB")
    rows = int(_number(status, "samples_per_ts", 1, 1e6))
    scale = float(f"{_number(status, 'sensitivity', 1e-9, 1e3):.6g}")  # a float32 in the file
    if kind == "gyro" and scale > _LARGEST_DPS:
        remarks.append(f"a gyroscope's sensitivity of {scale:g} is assumed to be in mdps, not dps")
        scale = float(f"{scale / 1000.0:.6g}")
    size = int(_number(status, "sd_dps" if on_card else "usb_dps", 8, 1e7))
    data, there = _joined(file.read_bytes(), size if on_card else size + _COUNTER)
    frame = np.dtype([("counts", "<i2", (rows, 3)), ("time_s", "<f8")])
    count = len(data) // frame.itemsize
    if not count:
        raise ValueError(f"{file.name} contains no whole frame of {rows} samples")
    frames = data[: count * frame.itemsize].view(frame)
    known = there[: count * frame.itemsize].reshape(count, frame.itemsize)
    sound = known[:, :-_TIME].reshape(count * rows, 6).all(axis=1)
    ends = np.where(known[:, -_TIME:].all(axis=1), frames["time_s"], np.nan)
    time_s = _times(ends, _number(status, "ioffset", -1e9, 1e9), rows)
    return _Sensor(frames["counts"].reshape(-1, 3)[sound], time_s[sound], scale)


def _joined(raw: bytes, packet: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return the bytes of packets without their counters, and which of them are there."""
    starts = range(0, len(raw) - _COUNTER, packet)
    pieces = [np.frombuffer(raw[at + _COUNTER : at + packet], np.uint8) for at in starts]
    counters = [int.from_bytes(raw[at : at + _COUNTER], "little") for at in starts]
    ends = np.array(counters, np.int64)
    ends[1:] += _WRAP * np.cumsum(np.diff(ends) < 0)
    if pieces and ends[0] < len(pieces[0]):  # no end is so early: it counts up to its beginning
        ends += [len(piece) for piece in pieces]
    begins = ends - [len(piece) for piece in pieces]
    if not len(ends) or begins[0] < 0 or (begins[1:] < ends[:-1]).any() or ends[-1] > MOST_BYTES:
        raise ValueError("packet counters do not increase as they should")
    data, there = np.zeros(int(ends[-1]), np.uint8), np.zeros(int(ends[-1]), np.bool_)
    for piece, begin, end in zip(pieces, begins.tolist(), ends.tolist(), strict=True):
        data[begin:end], there[begin:end] = piece, True
    return data, there


def _times(ends: NDArray[np.float64], begin: float, rows: int) -> NDArray[np.float64]:
    """Return the time of each row: even steps from one time of a frame to the next."""
    known = np.flatnonzero(np.isfinite(ends))
    if len(known) == 0 or (np.diff(ends[known]) <= 0.0).any() or ends[known[0]] <= begin:
        raise ValueError("the times of the frames do not increase")
    at = np.concatenate([[0], (known + 1) * rows - 1])
    there = np.concatenate([[begin], ends[known]])
    return np.asarray(np.interp(np.arange(len(ends) * rows), at, there), np.float64)


def _together(first: _Sensor, second: _Sensor) -> tuple[_Sensor, _Sensor] | None:
    """Return the rows of two sensors that are of one time; None where most are not."""
    period = float(np.median(np.diff(first.time_s))) if len(first.time_s) > 1 else 0.0
    at = np.searchsorted(second.time_s, first.time_s - 0.5 * period)
    at = np.minimum(at, len(second.time_s) - 1)
    same = np.abs(second.time_s[at] - first.time_s) < 0.25 * period
    if np.count_nonzero(same) < _MOSTLY * max(len(first.time_s), len(second.time_s)):
        return None
    return (
        replace(first, counts=first.counts[same], time_s=first.time_s[same]),
        replace(second, counts=second.counts[at[same]], time_s=first.time_s[same]),
    )
