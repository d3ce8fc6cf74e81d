"""The files of a Linux machine that has an LSM6DSM under st_lsm6dsx: sysfs, and nodes as FIFOs.

Names, types and scales are those of the kernel's driver: gyroscope and accelerometer are two
devices with a buffer each, a scan is three 16-bit counts, padding, and the time in ns.
"""

from __future__ import annotations

import os
import struct
import threading
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

KINDS = {"gyro": "anglvel", "accel": "accel"}
SCALES = {
    "gyro": "0.000076358 0.000152716 0.000305432 0.000610865 0.001221730",
    "accel": "0.000598205 0.001196411 0.002392822 0.004785644",
}
RATES = "12.500 26.000 52.000 104.000 208.000 416.000"


def make_device(root: Path, number: int, kind: str, part: str = "lsm6dsm") -> Path:
    """Make the folder of a device and its node; return the folder."""
    folder = root / "sys" / f"iio:device{number}"
    (folder / "scan_elements").mkdir(parents=True)
    (folder / "buffer").mkdir()
    (root / "dev").mkdir(exist_ok=True)
    name = KINDS[kind]
    files = {
        "name": f"{part}_{kind}",
        "sampling_frequency": "104.000",
        "sampling_frequency_available": RATES,
        f"in_{name}_scale": SCALES[kind].split()[1 if kind == "gyro" else 0],
        f"in_{name}_scale_available": SCALES[kind],
        "current_timestamp_clock": "realtime",
        "buffer/enable": "0",
        "buffer/length": "2",
        "buffer/watermark": "1",
    }
    elements = [*(f"{name}_{axis}" for axis in "xyz"), "timestamp"]
    for index, element in enumerate(elements):
        files[f"scan_elements/in_{element}_en"] = "0"
        files[f"scan_elements/in_{element}_index"] = str(index)
        kind_of = "le:s64/64>>0" if element == "timestamp" else "le:s16/16>>0"
        files[f"scan_elements/in_{element}_type"] = kind_of
    for path, text in files.items():
        (folder / path).write_text(text + "\n")
    os.mkfifo(root / "dev" / folder.name)
    return folder


def scans(counts: NDArray[np.int64], times_ns: NDArray[np.int64]) -> list[bytes]:
    """Return the bytes of each scan."""
    rows = zip(counts.tolist(), times_ns.tolist(), strict=True)
    return [struct.pack("<3h2xq", *row, at) for row, at in rows]


class Driver:
    """Writes scans into the nodes while their buffers are on, as the kernel would.

    Parameters
    ----------
    root : Path
        Where `make_device` made the files.
    streams : dict
        Number of a device to its scans.
    burst : int
        Scans that come at a time.
    pause_s : float
        Between bursts.
    """

    def __init__(
        self, root: Path, streams: dict[int, list[bytes]], burst: int = 10, pause_s: float = 0.01
    ) -> None:
        self._root = root
        self._streams = streams
        self._burst, self._pause_s = burst, pause_s
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Driver:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join(30.0)

    def _run(self) -> None:
        nodes: dict[int, int] = {}
        longest = max(len(one) for one in self._streams.values())
        at = 0
        while at < longest and not self._done.is_set():
            for number in self._streams.keys() - nodes.keys():
                self._try_open(number, nodes)
            on = [self._is_on(number) for number in self._streams]
            if len(nodes) == len(self._streams) and all(on):
                try:
                    for number, fd in nodes.items():
                        os.write(fd, b"".join(self._streams[number][at : at + self._burst]))
                except BrokenPipeError:  # the reader has gone
                    break
                at += self._burst
            time.sleep(self._pause_s)
        self._done.wait()
        for fd in nodes.values():
            os.close(fd)

    def _try_open(self, number: int, nodes: dict[int, int]) -> None:
        try:
            path = self._root / "dev" / f"iio:device{number}"
            nodes[number] = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
            os.set_blocking(nodes[number], True)
        except OSError:  # nobody reads it yet
            return

    def _is_on(self, number: int) -> bool:
        path = self._root / "sys" / f"iio:device{number}" / "buffer" / "enable"
        return path.read_text().strip() == "1"
