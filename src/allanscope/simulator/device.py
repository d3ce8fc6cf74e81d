"""A board on a cable: firmware, a port, and a thread in which time passes.

The real firmware runs as well (`run_emulated`): on QEMU's B-L475E-IOT01A, with its USART on a pty.
"""

from __future__ import annotations

import contextlib
import math
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType

from allanscope.errors import DeviceError, UsageError
from allanscope.simulator.faults import FaultSpec, parse_fault
from allanscope.simulator.firmware import RING_BYTES, Firmware
from allanscope.simulator.simulator import Simulator
from allanscope.simulator.transmitter import Ledger
from allanscope.simulator.virtual_port import VirtualPort, open_port

__all__ = ["EMULATED_WIRE", "Device", "run_device", "run_emulated"]

EMULATED_WIRE = "native"
"""Wire format of the firmware."""

FIRMWARE = Path(__file__).parents[3] / "firmware_protocol" / "device"

LONGEST_WAIT_S = 0.02
SHORTEST_WAIT_S = 0.002
"""Between two looks at the port: some 200 bytes at 6.66 kHz, far below what a pty holds."""
STRIDE_S = 0.05
"""Device time that passes between two writes when the device is late or runs fast."""
CATCH_UP = 4.0
"""How much faster than its speed it runs when it is late because the computer was busy. What it
owes, written at once, would overflow a ring that no real board would have filled."""
SETTLE_S = 0.05
"""pyserial throws away what is in a port that it has just opened; nothing is sent that soon."""


class Device:
    """The simulated SensorTile, plugged in.

    Its clock starts when a host opens the port for the first time, or writes to it. From then on
    it is a board with a battery: pulled out, closed or not read, it measures on. The ledger is
    exact as long as a host that closes the port stays away for some 20 ms: one that closes and
    opens within that time throws away what it has not read, and is not seen to do so.

    Parameters
    ----------
    sensor : Simulator, optional
        What it measures with; an LSM6DSM at 104 Hz when not given.
    wire : str
        Name of the wire format.
    faults : iterable of FaultSpec or str
        What goes wrong, see `parse_fault`.
    speed : float
        Device seconds per second. Infinity is as fast as the host reads, and drops nothing.
    path : Path or str, optional
        Where the port is to be; in a temporary folder when not given.
    port : VirtualPort, optional
        Another port than a pty.
    ring_bytes : int
        Size of the transmit ring.
    seed : int
        Of the faults.

    Attributes
    ----------
    url : str
        What a host opens.
    ledger : Ledger
        What became of every sample; final after `stop`.

    Examples
    --------
    ::

        with Device(Simulator(rate=416.0), faults=["bit_flip:rate=1e-5"]) as device:
            port = serial.Serial(device.url, timeout=0.05)
    """

    def __init__(
        self,
        sensor: Simulator | None = None,
        wire: str = "native",
        faults: Iterable[FaultSpec | str] = (),
        speed: float = 1.0,
        *,
        path: Path | str | None = None,
        port: VirtualPort | None = None,
        ring_bytes: int = RING_BYTES,
        seed: int = 0,
    ) -> None:
        if not speed > 0.0:
            raise UsageError(f"a device cannot run at {speed:g} times real time")
        specs = [parse_fault(one) if isinstance(one, str) else one for one in faults]
        self._firmware = Firmware(
            sensor or Simulator(), wire, specs, ring_bytes=ring_bytes, seed=seed
        )
        self._speed = speed
        self._port = port or open_port(Path(path) if path else None)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="device", daemon=True)
        self._error: BaseException | None = None
        self._opened_s: float | None = None
        self._host = False
        self._start_s: float | None = None

    @property
    def url(self) -> str:
        """What a host opens."""
        return self._port.url

    @property
    def ledger(self) -> Ledger:
        """What became of every sample."""
        return self._firmware.ledger

    @property
    def epoch(self) -> int:
        """Epoch of the samples made now."""
        return self._firmware.epoch

    @property
    def true_hz(self) -> float:
        """True sample rate, which the host can only measure."""
        return self._firmware.sensor.clock.true_hz

    @property
    def start_s(self) -> float | None:
        """Host monotonic time at which its clock was started; None before."""
        return self._start_s

    def start(self) -> Device:
        """Plug it in and return it."""
        self._thread.start()
        return self

    def stop(self) -> None:
        """Pull it out and remove the port; raises what went wrong in its thread."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        self._port.close()
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until it has stopped by itself (it fails) or for `timeout_s`; return whether."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def __enter__(self) -> Device:
        return self.start()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()

    # -- the thread -----------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                data = self._port.read()
                self._update_host(bool(data))
                if data:
                    self._firmware.receive(data)
                self._port.wait(self._live())
        except BaseException as error:
            self._error = error

    def _update_host(self, spoke: bool) -> None:
        """Tell the firmware of a host that comes or goes, and pull or put back the cable."""
        firmware = self._firmware
        here = self._port.attached()
        if self._host and not here:
            self._host = False
            firmware.host_disconnected(self._port.forget())
        if not here:
            self._opened_s = None
            return
        if self._opened_s is None:
            self._opened_s = time.monotonic()
        settled = time.monotonic() - self._opened_s >= SETTLE_S
        if not self._host and (settled or spoke):
            self._host = True
            if self._start_s is None:
                self._start_s = time.monotonic()
            firmware.host_connected()

    def _live(self) -> float:
        """Let time pass and bytes go out; return how long there is nothing to do."""
        firmware = self._firmware
        if self._start_s is None:
            return LONGEST_WAIT_S
        if math.isinf(self._speed):
            return self._live_fast()
        target_s = (time.monotonic() - self._start_s) * self._speed
        until_s = min(target_s, firmware.now_s + STRIDE_S * max(self._speed, 1.0))
        while firmware.now_s < until_s and not self._stopping.is_set():
            self._pass_time(min(until_s, firmware.now_s + STRIDE_S))
        blocked = self._write()
        if until_s < target_s:
            return STRIDE_S / CATCH_UP
        ahead_s = (firmware.next_s - target_s) / self._speed
        longest = SHORTEST_WAIT_S if blocked else LONGEST_WAIT_S
        return min(max(ahead_s, SHORTEST_WAIT_S), longest)

    def _live_fast(self) -> float:
        firmware = self._firmware
        for _ in range(64):
            if firmware.would_drop or math.isinf(firmware.next_s):
                break
            self._pass_time(firmware.next_s)
        blocked = self._write() or firmware.would_drop
        return SHORTEST_WAIT_S if blocked or math.isinf(firmware.next_s) else 0.0

    def _pass_time(self, until_s: float) -> None:
        plugged = self._firmware.plugged
        self._firmware.advance(until_s)
        if plugged and not self._firmware.plugged:
            self._host, self._opened_s = False, None
            self._firmware.host_disconnected(self._port.unplug())
        elif not plugged and self._firmware.plugged:
            self._port.replug()
        self._write()

    def _write(self) -> bool:
        """Write what is to be written; return whether the port is full."""
        while len(data := self._firmware.pending()):
            taken = self._port.write(data)
            self._firmware.written(taken)
            if not taken:
                return True
        return False


def run_device(
    device: Device,
    duration_s: float | None = None,
    announce: Callable[[str], None] = print,
) -> Ledger:
    """Plug a device in, announce its port, and keep it until Ctrl-C or for a time.

    Parameters
    ----------
    device : Device
        Not yet started.
    duration_s : float, optional
        Real seconds; for ever when not given.
    announce : callable
        Told the URL once it can be opened.

    Returns
    -------
    Ledger
        What became of every sample.
    """
    with device, contextlib.suppress(KeyboardInterrupt):
        announce(device.url)
        device.wait(duration_s)
    return device.ledger


def run_emulated(duration_s: float | None = None, link: Path | None = None) -> None:
    """Build the firmware, start it, print its port, and keep it until Ctrl-C or for a time.

    Parameters
    ----------
    duration_s : float, optional
        Real seconds; for ever when not given.
    link : Path, optional
        Where the port is to be; in a temporary folder when not given.

    Raises
    ------
    DeviceError
        When the firmware's sources, the compiler or QEMU are not there; says how to get them.
    """
    if not FIRMWARE.is_dir():
        raise DeviceError("the firmware is not part of the installed package: run from a checkout")
    for tool, package in (
        ("make", "make"),
        ("arm-none-eabi-gcc", "gcc-arm-none-eabi"),
        ("qemu-system-arm", "qemu-system-arm, version 10 or later"),
    ):
        if shutil.which(tool) is None:
            raise DeviceError(f"{tool} is not on this machine; install {package}")
    with tempfile.TemporaryDirectory(prefix="allanscope-") as folder:
        subprocess.run(["make", "-s", "-C", str(FIRMWARE), f"OUT={folder}"], check=True)
        port = link or Path(folder) / "ttySensorTile"
        if port.exists() and not port.is_symlink():
            raise UsageError(f"{port} exists and is not a link; choose another path")
        port.unlink(missing_ok=True)  # one that an earlier QEMU has left behind
        command = ["qemu-system-arm", "-M", "b-l475e-iot01a", "-kernel", f"{folder}/paced.elf"]
        command += ["-display", "none", "-monitor", "none", "-serial", "chardev:usart"]
        command += ["-chardev", f"pty,id=usart,path={port}"]
        quiet = subprocess.DEVNULL
        process = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=subprocess.PIPE)
        try:
            while process.poll() is None and not port.exists():
                time.sleep(0.02)
            if port.exists():
                print(port, flush=True)
            process.wait(duration_s)
        except (subprocess.TimeoutExpired, KeyboardInterrupt):
            return
        finally:
            process.terminate()
            said = process.communicate()[1].decode(errors="replace").split("\n")[0]
            port.unlink(missing_ok=True)
        raise DeviceError(f"QEMU ended with status {process.returncode}: {said}")
