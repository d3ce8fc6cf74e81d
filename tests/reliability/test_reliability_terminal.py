"""A terminal that goes away, as when a connection drops, ends nothing but itself."""

from __future__ import annotations

import os
import subprocess
import sys

KEYS = """
import os, sys, threading, time
from allanscope.view.console import Keys
keys = Keys({})
assert keys.active
print("ready", flush=True)
deadline = time.monotonic() + 60.0
while keys._thread.is_alive() and time.monotonic() < deadline:
    time.sleep(0.01)
before = os.open(os.devnull, os.O_WRONLY)
keys.close()
os.fstat(before)
sys.exit(7)
"""


def test_keys_outlive_their_terminal() -> None:
    """Its end is noticed, closing it is no error, and no other file is touched."""
    near, far = os.openpty()
    said = subprocess.PIPE
    command = [
        sys.executable,
        "-c",
        "import os, signal, fcntl, termios\n"
        "os.setsid()\n"
        "fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
        "signal.signal(signal.SIGHUP, signal.SIG_IGN)\n" + KEYS,
    ]
    with subprocess.Popen(command, stdin=far, stdout=said, stderr=said, text=True) as child:
        os.close(far)
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        os.close(near)
        _, complaint = child.communicate(timeout=90.0)
    assert child.returncode == 7, complaint
