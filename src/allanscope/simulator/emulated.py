"""The real firmware on an emulated board: QEMU's B-L475E-IOT01A with its USART on a pty."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from pathlib import Path

from allanscope.errors import DeviceError, UsageError

__all__ = ["EMULATED_WIRE", "run_emulated"]

EMULATED_WIRE = "native"
"""What the firmware of the board speaks."""

FIRMWARE = Path(__file__).parents[3] / "firmware_protocol" / "device"


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
            raise UsageError(f"{port} exists and is no link; choose another path")
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
