"""QEMU's B-L475E-IOT01A running the firmware, its USART on a pty or in a file."""

import subprocess
import time
from pathlib import Path


class Board:
    """One emulated board.

    Parameters
    ----------
    firmware : Path
        ELF file.
    usart : list of str
        QEMU's options for the serial port.
    port : Path
        What appears when the serial port is there.
    """

    def __init__(self, firmware, usart, port):
        self.port = port
        self._command = ["qemu-system-arm", "-M", "b-l475e-iot01a", "-kernel", str(firmware)]
        self._command += ["-display", "none", "-monitor", "none", *usart]
        self.start()

    def start(self):
        """Power on. QEMU leaves its symlink behind when it dies, so it is removed first."""
        self.port.unlink(missing_ok=True)
        quiet = subprocess.DEVNULL
        self._process = subprocess.Popen(self._command, stdin=quiet, stdout=quiet, stderr=quiet)
        self.wait_until(self.port.exists)

    def wait_until(self, condition, patience_s=60.0):
        """Wait for something that the board does; the patience is only an upper bound."""
        deadline = time.monotonic() + patience_s
        while not condition():
            if time.monotonic() > deadline or self._process.poll() is not None:
                raise RuntimeError("the emulated board did not do what was waited for")
            time.sleep(0.02)

    def kill(self):
        """Pull the plug."""
        self._process.kill()
        self._process.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.kill()


class Boards:
    """Starts boards with the firmware of one build."""

    def __init__(self, build, folder):
        self._build = Path(build)
        self._folder = Path(folder)

    def on_pty(self, clock):
        """Return a running board whose `port` can be opened."""
        port = self._folder / f"tty-{clock}"
        options = ["-chardev", f"pty,id=usart,path={port}", "-serial", "chardev:usart"]
        return Board(self._build / f"{clock}.elf", options, port)

    def to_file(self, clock, out):
        """Return a running board that writes into a file from its first byte on."""
        return Board(self._build / f"{clock}.elf", ["-serial", f"file:{out}"], out)
