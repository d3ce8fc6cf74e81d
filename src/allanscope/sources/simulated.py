"""The simulated SensorTile as a source: a device on a port of its own, read as any other."""

from __future__ import annotations

from collections.abc import Iterable

from allanscope.simulator import Device, FaultSpec, Simulator
from allanscope.sources.base import Chunk, SourceSettings
from allanscope.sources.serial_port import SerialSource

__all__ = ["SimulatedSource"]


class SimulatedSource:
    """Plugs in a simulated device and reads its port.

    Nothing is short-cut: the bytes go through a pseudo-terminal and the serial source, so what
    works here works with a board.

    Parameters
    ----------
    wire : str
        Name of the wire format.
    speed : float
        Device seconds per second; infinity for as fast as it is read.
    sensor : Simulator, optional
        What the device measures with; an LSM6DSM at 104 Hz when not given.
    faults : iterable of FaultSpec or str
        What goes wrong, see `allanscope.simulator.parse_fault`.
    seed : int
        Of the faults.
    settings : SourceSettings, optional
        Of the serial source.
    """

    def __init__(
        self,
        wire: str = "native",
        speed: float = 1.0,
        *,
        sensor: Simulator | None = None,
        faults: Iterable[FaultSpec | str] = (),
        seed: int = 0,
        settings: SourceSettings | None = None,
    ) -> None:
        self.device = Device(sensor, wire, faults, speed, seed=seed).start()
        try:
            self._serial = SerialSource(self.device.url, settings)
        except BaseException:
            self.device.stop()
            raise

    @property
    def name(self) -> str:
        """Always ``sim``."""
        return "sim"

    @property
    def identity(self) -> dict[str, str]:
        """What it is and where its port is."""
        return {"product": "simulated SensorTile", "path": self.device.url}

    @property
    def reader(self) -> str:
        """Who reads the port of the device."""
        return self._serial.reader

    def read(self) -> Chunk:
        """Return the next chunk, with empty data after about a tenth of a second of silence."""
        return self._serial.read()

    def write(self, data: bytes) -> None:
        """Send bytes to the device."""
        self._serial.write(data)

    def close(self) -> None:
        """Close the port and stop the device; nothing of either is left."""
        self._serial.close()
        self.device.stop()
