"""What the user asked for, checked once and handed on."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from allanscope.analysis import ReferenceCurve
from allanscope.errors import UsageError
from allanscope.parts import part_named
from allanscope.samples import Origin
from allanscope.wire import WireSettings, format_named
from allanscope.wire.text import quantity_named, sensor_of_name

__all__ = ["DeviceSettings", "SessionSettings", "SimulatedSettings", "ViewMode"]

ViewMode = Literal["auto", "window", "web", "none"]


@dataclass(frozen=True, slots=True)
class DeviceSettings:
    """What the user said about the device; empty or None where the stream must tell.

    `stream` is which one of several sensors in a file: the topic of a bag. `baud` is the line rate
    of a UART; None for the usual one of the wire format. `sensor` is that of columns which name
    none, as `of_file` knows it.

    Raises
    ------
    UsageError
        For a part, a full scale, a rate, a wire format or a unit that does not exist.
    """

    part: str = ""
    rate_hz: float | None = None
    gyro_fs: float | None = None
    accel_fs: float | None = None
    wire: str = ""
    units: Sequence[tuple[str, str]] = field(default_factory=tuple)
    origin: Origin = ""
    stream: str = ""
    baud: int | None = None
    sensor: str = ""

    def __post_init__(self) -> None:
        part = part_named(self.part or "LSM6DSM")
        if self.part:
            object.__setattr__(self, "part", part.name)
        if self.rate_hz is not None and not 0.0 < self.rate_hz < 1e6:
            raise UsageError(f"a sample rate of {self.rate_hz:g} Hz is not possible")
        if self.baud is not None and self.baud <= 0:
            raise UsageError(f"a baud rate of {self.baud} is not possible")
        if self.gyro_fs is not None:
            part.gyro_scale(self.gyro_fs)
        if self.accel_fs is not None:
            part.accel_scale(self.accel_fs)
        if self.wire:
            format_named(self.wire)
        for group, unit in self.units:
            quantity_named(group, unit)

    @property
    def simulated_wire(self) -> str:
        """What a simulated device speaks: the native protocol unless the user chose another."""
        return self.wire or "native"

    def of_file(self, path: Path) -> DeviceSettings:
        """Return the settings with what the name of a text file says of its sensor.

        >>> DeviceSettings().of_file(Path("night/Accelerometer.csv")).sensor
        'accel'
        """
        return replace(self, sensor=sensor_of_name(path.stem))

    def for_wire(self) -> WireSettings:
        """Return the part of it that decoders need."""
        return WireSettings(
            part=self.part,
            rate_hz=self.rate_hz,
            gyro_fs=self.gyro_fs,
            accel_fs=self.accel_fs,
            units=dict(self.units),
            origin=self.origin,
            sensor=self.sensor,
        )

    @property
    def full_scales(self) -> dict[str, float]:
        """Full scales that were named, by unit."""
        given = {"dps": self.gyro_fs, "g": self.accel_fs}
        return {unit: value for unit, value in given.items() if value is not None}

    def metadata(self) -> dict[str, str]:
        """Return what a recording keeps of it, as text; `recorded_settings` reads it again."""
        facts = {
            "part": self.part,
            "rate_hz": "" if self.rate_hz is None else repr(self.rate_hz),
            "gyro_fs": "" if self.gyro_fs is None else repr(self.gyro_fs),
            "accel_fs": "" if self.accel_fs is None else repr(self.accel_fs),
            "wire": self.wire,
            "units": " ".join(f"{sensor}={unit}" for sensor, unit in self.units),
            "origin": self.origin,
            "sensor": self.sensor,
        }
        return {name: text for name, text in facts.items() if text}


@dataclass(frozen=True, slots=True)
class SessionSettings:
    """How a session is shown and kept.

    Raises
    ------
    UsageError
        When there is no such program as `on_event` names.

    Attributes
    ----------
    out : Path or None
        Folder of the session; None for a new one named after time and device.
    view : str
        ``auto`` is a window where there is a display, else the web viewer.
    quiet : bool
        Say nothing but errors on the terminal.
    duration_s : float or None
        Stop this long after the first byte; None for never.
    view_port : int or None
        Of the page of the web viewer, with the data at the one after it; None for any free ones.
    on_event : str
        Command that is run for each event; empty for none.
    events_to : Path or None
        Pipe or file that gets a line of JSON for each event.
    window_s : float
        Length in s of the windows of the Allan deviation over time; 0 has them grow with the run.
    references : mapping
        Curves to compare with, by axis.
    folder : Path
        Where the folder of a new session is made, when `out` is not given.
    """

    out: Path | None = None
    view: ViewMode = "auto"
    quiet: bool = False
    duration_s: float | None = None
    view_port: int | None = None
    on_event: str = ""
    events_to: Path | None = None
    window_s: float = 0.0
    references: Mapping[str, ReferenceCurve] = field(default_factory=dict)
    folder: Path = Path()

    def __post_init__(self) -> None:
        try:
            words = shlex.split(self.on_event)
        except ValueError as error:
            raise UsageError(f"--on-event {self.on_event!r}: {error}") from None
        if words and shutil.which(words[0]) is None:
            raise UsageError(f"--on-event: there is no program {words[0]!r}")


@dataclass(frozen=True, slots=True)
class SimulatedSettings:
    """What the simulated SensorTile is to be like, in the words of the command line."""

    seed: int = 0
    effects: Sequence[str] = ()
    faults: Sequence[str] = ()
    noise: Sequence[str] = ()
    truth: Path | None = None
