"""A simulated SensorTile in a process of its own, told by JSON what lives it is to have.

    python simulated_device.py PATH '[{"seconds": 5, "rate": 416, "faults": ["reset:at=2"]}, ...]'

Says ``ready`` when its port is at PATH. Between two lives it is gone. When its input ends or all
lives are over it prints what became of every sample, a list with one entry for each life.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from pathlib import Path
from typing import Any

from allanscope.samples import AXES
from allanscope.simulator import Device, Ledger, Simulator


def live(path: Path, life: dict[str, Any], over: threading.Event) -> Ledger:
    sensor = Simulator(
        "LSM6DSM",
        life.get("rate", 416.0),
        life.get("seed", 0),
        gyro_fs=life.get("gyro_fs", 125.0),
        axes=tuple(life.get("axes", AXES)),
        duration_s=3600.0,
    )
    device = Device(
        sensor, life.get("wire", "native"), life.get("faults", ()), path=path, seed=life["boot"]
    )
    with device:
        print("ready", flush=True)
        over.wait(life.get("seconds", 600.0))
    return device.ledger


def told(ledger: Ledger) -> dict[str, Any]:
    losses = [[one.epoch, one.first, one.count, one.cause] for one in ledger.losses]
    return {"produced": ledger.produced, "losses": losses, "faults": dict(ledger.faults)}


def main() -> None:
    path, lives = Path(sys.argv[1]), json.loads(sys.argv[2])
    over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
    ledgers = []
    for number, life in enumerate(lives):
        if over.is_set():
            break
        if number:
            time.sleep(0.5)
        ledgers.append(told(live(path, {"boot": number, **life}, over)))
    print(json.dumps(ledgers), flush=True)


if __name__ == "__main__":
    main()
