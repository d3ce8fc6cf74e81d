"""The simulated SensorTile from the command line: as a recording, and as a port."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path

from allanscope.errors import UsageError
from allanscope.pipeline.settings import DeviceSettings, SimulatedSettings
from allanscope.recording import Chunk, write_recording
from allanscope.simulator import Device, Ledger, Simulator, Truth, run_device, simulate_blocks
from allanscope.view import progress

__all__ = ["run_emulated_device", "run_virtual_device", "simulate_recording", "simulator"]


def simulator(
    device: DeviceSettings, simulated: SimulatedSettings, duration_s: float = 3600.0
) -> Simulator:
    """Return the sensor that the user described."""
    part = device.part or "LSM6DSM"
    truth = Truth.load(simulated.truth) if simulated.truth else Truth.typical(part, simulated.seed)
    return Simulator(
        part,
        device.rate_hz or 104.0,
        simulated.seed,
        truth=truth.with_noise(simulated.noise).with_effects(simulated.effects),
        gyro_fs=device.gyro_fs or 125.0,
        accel_fs=device.accel_fs or 2.0,
        duration_s=duration_s,
    )


def simulate_recording(
    out: Path, hours: float, device: DeviceSettings, simulated: SimulatedSettings, quiet: bool
) -> Path:
    """Write a recording of the simulated device, much faster than real time; return its file.

    Raises
    ------
    UsageError
        When the file exists, cannot be written, or the hours make no sense.
    """
    if not 0.0 < hours < 1e5:
        raise UsageError(f"{hours:g} hours is not a possible length")
    sensor = simulator(device, simulated, hours * 3600.0)
    wire = device.simulated_wire
    with progress(hours * 3600.0, "simulating", unit="s", quiet=quiet) as advance:

        def chunks() -> Iterator[Chunk]:
            before = None
            for host_ns, data in simulate_blocks(
                hours, sensor, wire, start_ns=1, seed=simulated.seed
            ):
                advance(0.0 if before is None else (host_ns - before) * 1e-9)
                before = host_ns
                yield Chunk(host_ns, data)

        return write_recording(
            out, chunks(), {"name": "simulated", "wire": wire, "origin": sensor.info.origin}
        )


def run_virtual_device(
    device: DeviceSettings,
    simulated: SimulatedSettings,
    duration_s: float | None,
    link: Path | None = None,
) -> Ledger:
    """Run the simulated device on a virtual serial port until Ctrl-C or for a time.

    Prints the port as soon as it can be opened. Returns what became of every sample.
    """
    one = Device(
        simulator(device, simulated),
        device.simulated_wire,
        simulated.faults,
        path=link,
        seed=simulated.seed,
    )
    # Stopped by SIGTERM as by Ctrl-C: the port is closed and its link removed.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with contextlib.suppress(KeyboardInterrupt):
        run_device(one, duration_s, lambda url: print(url, flush=True))
    return one.ledger


def run_emulated_device(
    device: DeviceSettings,
    simulated: SimulatedSettings,
    duration_s: float | None,
    link: Path | None = None,
) -> None:
    """Run the real firmware on an emulated board until Ctrl-C or for a time; print its port.

    Raises
    ------
    UsageError
        When it is asked for what only the simulated device can do.
    """
    from allanscope.simulator import EMULATED_WIRE, run_emulated

    if device.simulated_wire != EMULATED_WIRE or simulated.faults or simulated.effects:
        raise UsageError(
            "the emulated board runs the native firmware, without faults or effects; "
            "leave out --emulated for those"
        )
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    run_emulated(duration_s, link)
