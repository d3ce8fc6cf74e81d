"""Live sessions in a process of its own, one after another, each ended by a signal from outside.

    python sessions_process.py PORT FOLDER COUNT

Says ``watching`` when samples flow, and ``ended N`` with the number of samples of each session.
"""

from __future__ import annotations

import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

from allanscope.errors import InputError
from allanscope.pipeline import DeviceSettings, SessionSettings, SimulatedSettings, run_live
from allanscope.recording import Recording


def announce(folder: Path) -> None:
    """Wait until a second of samples is on the disk."""
    while True:
        time.sleep(0.1)
        with suppress(InputError):  # the folder is there a moment before the recording
            if folder.exists() and sum(len(c.data) for c in Recording(folder).chunks()) > 3000:
                print("watching", flush=True)
                return


def main() -> None:
    for number in range(int(sys.argv[3])):
        folder = Path(sys.argv[2]) / f"S{number}"
        threading.Thread(target=announce, args=(folder,), daemon=True).start()
        settings = SessionSettings(out=folder, view="none", quiet=True)
        analysis = run_live(sys.argv[1], DeviceSettings(), settings, SimulatedSettings())
        print(f"ended {analysis.samples}", flush=True)


if __name__ == "__main__":
    main()
