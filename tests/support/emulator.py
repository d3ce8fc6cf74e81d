"""QEMU's B-L475E-IOT01A running the firmware, its USART on a pty or in a file."""

import os
import subprocess
import time
from pathlib import Path

PATIENCE_S = 60.0
"""Processor time that a board may take for what is waited for: a busy machine gives it later."""


def processor_s(pid):
    """Return the processor time that a process and its children have had."""
    process = Path(f"/proc/{pid}")
    try:
        fields = (process / "stat").read_text().rpartition(")")[2].split()
        children = " ".join(path.read_text() for path in process.glob("task/*/children")).split()
    except (FileNotFoundError, ProcessLookupError):  # it has just ended
        return 0.0
    own_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return own_s + sum(map(processor_s, children))


class Patience:
    """How long to wait for something that a process does, in what it did meanwhile.

    Parameters
    ----------
    process : Popen
        Which does it.
    """

    def __init__(self, process):
        self._process = process
        self._until_s = processor_s(process.pid) + PATIENCE_S

    def ended(self):
        """Return whether the process is gone, or had time enough."""
        return self._process.poll() is not None or processor_s(self._process.pid) > self._until_s


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
        """Power on."""
        self.port.unlink(missing_ok=True)
        quiet = subprocess.DEVNULL
        self._process = subprocess.Popen(self._command, stdin=quiet, stdout=quiet, stderr=quiet)
        self.wait_until(self.port.exists)

    def patience(self):
        """Return how long to wait for what the board does, from now on."""
        return Patience(self._process)

    def wait_until(self, condition):
        """Wait for something that the board does."""
        patience = self.patience()
        while not condition():
            if patience.ended():
                raise RuntimeError("the emulated board did not do what was waited for")
            time.sleep(0.02)

    def kill(self):
        """Pull the plug. QEMU leaves a link behind, to a terminal that is soon somebody else's."""
        if self.port.is_symlink():
            self.port.unlink()
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
