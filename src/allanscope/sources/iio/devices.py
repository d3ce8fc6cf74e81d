"""What the kernel offers, its settings, and buffers switched on and off (sysfs)."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from allanscope.errors import DeviceError
from allanscope.parts import PARTS
from allanscope.sanitize import sanitize
from allanscope.sources.iio.scans import AXIS_NAMES, TIME, ScanElement, ScanLayout, scale_of

__all__ = ["DEV", "SYSFS", "IioDevice", "IioSensor", "find_iio_sensors", "iio_sensor", "part_name"]

SYSFS = Path("/sys/bus/iio/devices")
DEV = Path("/dev")
BUFFER_S = 4.0
"""What the kernel's buffer holds while this program is held up."""
WAKE_S = 0.05
"""So much is gathered before the kernel wakes the reader, where the device can do it."""
MOST_BITS = 16
NEAREST = 0.05
"""A rate is taken for the nearest of the driver's when it is within this share of it."""
_SAME = 1e-3
_SENSORS = {"anglvel": "g", "accel": "a"}


@dataclass(frozen=True, slots=True)
class IioDevice:
    """One device of the kernel: a gyroscope, an accelerometer, or both.

    Attributes
    ----------
    folder : Path
        Where its attributes are.
    node : Path
        Where its scans come from.
    """

    folder: Path
    node: Path

    @property
    def name(self) -> str:
        """As the driver calls it, e.g. ``lsm6dsm_gyro``."""
        return sanitize(self._text("name"))

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that its buffer can have; none without a time."""
        scans = self._scans
        there = [ours for name, ours in AXIS_NAMES.items() if (scans / f"in_{name}_en").exists()]
        return tuple(there) if (scans / f"in_{TIME}_en").exists() else ()

    @property
    def rate_hz(self) -> float:
        """Sample rate that the driver claims, 0 where it claims none."""
        return next((self._number(path) for path in self._rates() if path.exists()), 0.0)

    def scale(self, axis: str, part: str = "") -> float:
        """Return dps or g per count.

        Raises
        ------
        DeviceError
            If the driver does not say it.
        """
        for path in self._scales(axis):
            if path.exists() and (per_count := self._number(path)) > 0.0:
                return scale_of(axis, per_count, part)
        raise DeviceError(f"{self.folder.name} ({self.name}) does not say its scale")

    def set_rate(self, wanted_hz: float) -> bool:
        """Set the rate that is nearest; False if the driver has none that is near."""
        for path in self._rates():
            if not path.exists():
                continue
            known = _numbers(path.with_name(path.name + "_available")) or [wanted_hz]
            nearest = min(known, key=lambda one: abs(one - wanted_hz))
            if abs(nearest - wanted_hz) <= NEAREST * nearest:
                self._put(path, f"{nearest:g}")
                return True
        return False

    def set_scale(self, axis: str, wanted: float, part: str) -> bool:
        """Set dps or g per count; False if the driver has no such scale."""
        for path in self._scales(axis):
            try:
                known = path.with_name(path.name + "_available").read_text().split()
            except OSError:
                continue
            for text in known:
                with suppress(ValueError):
                    if abs(scale_of(axis, float(text), part) / wanted - 1.0) < _SAME:
                        self._put(path, text)
                        return True
        return False

    def start(self, axes: Iterable[str]) -> ScanLayout:
        """Switch on the buffer with these axes and the time; return what a scan of it is.

        Raises
        ------
        DeviceError
            If it cannot be set up; the message says why.
        """
        wanted = {TIME} | {name for name, ours in AXIS_NAMES.items() if ours in axes}
        self.stop()
        with suppress(OSError):  # a clock that is set would tear the times apart
            (self.folder / "current_timestamp_clock").write_text("monotonic")
        elements = []
        for path in sorted(self._scans.glob("in_*_en")):
            name = path.name[len("in_") : -len("_en")]
            self._put(path, "1" if name in wanted else "0")
            if name in wanted:
                elements.append(self._element(name))
        rate = self.rate_hz or 100.0
        self._put(self._buffer / "length", str(max(64, round(BUFFER_S * rate))))
        with suppress(OSError):
            (self._buffer / "watermark").write_text(str(max(1, round(WAKE_S * rate))))
        try:
            (self._buffer / "enable").write_text("1")
        except OSError as error:
            raise DeviceError(
                f"{self.folder.name} ({self.name}) cannot be switched on: {error.strerror}; does "
                "it need a trigger (trigger/current_trigger), or does another program read it?"
            ) from None
        return ScanLayout(tuple(sorted(elements, key=lambda one: one.index)))

    def stop(self) -> None:
        """Switch off the buffer.

        Raises
        ------
        DeviceError
            If that is not permitted.
        """
        self._put(self._buffer / "enable", "0")

    def _element(self, name: str) -> ScanElement:
        folder = self._scans
        index = self._number(folder / f"in_{name}_index")
        try:
            one = ScanElement.of(name, int(index), (folder / f"in_{name}_type").read_text())
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self.folder.name} ({self.name}): {error}") from None
        if name != TIME and (one.bits > MOST_BITS or not one.signed):
            raise DeviceError(
                f"{self.folder.name} ({self.name}) has counts of {one.bits} bits, live only signed "
                "ones of 16 are read; record it with iio_readdev and analyse the folder"
            )
        return one

    @property
    def _scans(self) -> Path:
        return self._first_existing("scan_elements")

    @property
    def _buffer(self) -> Path:
        return self._first_existing("buffer")

    def _first_existing(self, name: str) -> Path:
        old = self.folder / name
        return old if old.is_dir() else self.folder / "buffer0"

    def _rates(self) -> list[Path]:
        kinds = {name for name, ours in AXIS_NAMES.items() if ours in self.axes}
        shared = [f"in_{name.rpartition('_')[0]}_sampling_frequency" for name in sorted(kinds)]
        return [self.folder / name for name in ("sampling_frequency", *dict.fromkeys(shared))]

    def _scales(self, axis: str) -> list[Path]:
        name = next(name for name, ours in AXIS_NAMES.items() if ours == axis)
        shared = name.rpartition("_")[0]
        return [self.folder / f"in_{one}_scale" for one in (shared, name)]

    def _text(self, name: str) -> str:
        try:
            return (self.folder / name).read_text("utf-8", "replace").strip()[:80]
        except OSError:
            return ""

    def _number(self, path: Path) -> float:
        return next(iter(_numbers(path)), 0.0)

    def _put(self, path: Path, text: str) -> None:
        try:
            path.write_text(text)
        except PermissionError:
            raise DeviceError(
                f"no permission to set {path}; run as root, or give your group the right with udev"
            ) from None
        except OSError as error:
            raise DeviceError(f"cannot set {path} to {text}: {error.strerror or error}") from None


@dataclass(frozen=True, slots=True)
class IioSensor:
    """One part: a device, or two that the driver makes of its gyroscope and its accelerometer.

    Attributes
    ----------
    name : str
        Name of the part as the driver has it, e.g. ``lsm6dsm``.
    devices : tuple of IioDevice
        The one with the gyroscope first.
    """

    name: str
    devices: tuple[IioDevice, ...]

    @property
    def part(self) -> str:
        """Name of the part, empty if it is none of ours."""
        return self.name.upper() if self.name.upper() in PARTS else ""

    def __str__(self) -> str:
        nodes = ", ".join(str(one.node) for one in self.devices)
        return f"iio:{self.name}  Linux IIO  ({nodes})"


def find_iio_sensors() -> list[IioSensor]:
    """Return what the kernel offers with a gyroscope or an accelerometer, gyroscopes first."""
    groups: dict[tuple[str, str], list[IioDevice]] = {}
    for folder in sorted(SYSFS.glob("iio:device*")):
        device = IioDevice(folder, DEV / folder.name)
        if device.axes:
            name = part_name(device.name or folder.name)
            # Two parts of one kind are at two places of the bus.
            place = os.path.dirname(os.path.realpath(folder))
            groups.setdefault((place, name), []).append(device)
    sensors = []
    for (_, name), devices in groups.items():
        kept: list[IioDevice] = []
        for device in sorted(devices, key=lambda one: one.axes):
            # An axis comes from one device only.
            if not any(set(device.axes) & set(other.axes) for other in kept):
                kept.append(device)
        kept.sort(key=lambda one: "gx" not in one.axes)
        sensors.append(IioSensor(name, tuple(kept)))
    return sorted(sensors, key=lambda one: ("gx" not in one.devices[0].axes, not one.part))


def part_name(device: str) -> str:
    """Return the name of the part of which a driver makes a device.

    Examples
    --------
    >>> part_name("lsm6dsm_gyro")
    'lsm6dsm'
    """
    return device.removesuffix("_gyro").removesuffix("_accel")


def iio_sensor(spec: str) -> IioSensor:
    """Return the sensor that ``iio``, ``iio:lsm6dsm`` or ``iio:device0`` means.

    Raises
    ------
    DeviceError
        If there is none; the message says what there is.
    """
    wanted = spec.partition(":")[2].lower()
    sensors = find_iio_sensors()
    for sensor in sensors:
        names = {sensor.name.lower()}
        for one in sensor.devices:
            names |= {one.name.lower(), one.folder.name.lower().partition(":")[2]}
        if not wanted or wanted in names:
            return sensor
    there = ", ".join(f"iio:{one.name}" for one in sensors)
    what = f"no sensor {spec}" if wanted else "no gyroscope or accelerometer of Linux IIO"
    raise DeviceError(
        f"{what}; {f'there is {there}' if there else f'nothing of the kind is in {SYSFS}'}"
    )


def _numbers(path: Path) -> list[float]:
    """Return the numbers in a file, none if it cannot be read."""
    found = []
    with suppress(OSError, ValueError):
        found = [float(text) for text in path.read_text().split()]
    return found
