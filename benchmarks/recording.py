"""What a recording costs and what a crash costs it.

    python benchmarks/recording.py [--megabytes 200] [--kills 10]

Measures, on noise in frames like those of the native wire format: writing and reading speed and
packed size at several sizes of a read; what a process that is killed with SIGKILL at a random
moment loses at the pace of 6 axes at 6.66 kHz; what a flipped byte costs.
"""

from __future__ import annotations

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from allanscope.recording import Chunk, Recorder, Recording, SessionWriter, write_recording
from allanscope.recording.recorder import COMMIT_S

FRAME_BYTES = 224
LIVE_BYTES_PER_S = 93_200
READ_S = 0.01

CHILD = "import recording, sys; recording.record_for_ever(sys.argv[1])"


def frames(count: int, seed: int = 1) -> bytes:
    """Return frames of 16 samples, sigma 8 counts, with running number, time and checksum."""
    source = np.random.default_rng(seed)
    frame = np.zeros((count, FRAME_BYTES), np.uint8)
    samples = source.normal(0.0, 8.0, (count, 96)).round().astype("<i2")
    frame[:, 26:218] = samples.view(np.uint8).reshape(count, 192)
    frame[:, 8:12] = (16 * np.arange(count)).astype("<u4").view(np.uint8).reshape(count, 4)
    frame[:, 12:20] = (2402 * np.arange(count)).astype("<u8").view(np.uint8).reshape(count, 8)
    frame[:, 218:222] = source.integers(0, 256, (count, 4))
    return frame.tobytes()


def reads(data: bytes, size: int, total: int) -> Iterator[Chunk]:
    """Yield reads of one size until so many bytes have passed."""
    for number in range(total // size):
        start = number * size % (len(data) - size)
        yield Chunk(1 + int(number * size / LIVE_BYTES_PER_S * 1e9), data[start : start + size])


def speed(folder: Path, size: int, total: int) -> None:
    """Write and read one recording; print MB/s."""
    data = frames(20_000)
    began = time.perf_counter()
    path = write_recording(folder / f"speed{size}.mcap", reads(data, size, total), {})
    written = time.perf_counter()
    volume = sum(len(buffer.data) for buffer in Recording(path).buffers())
    read = time.perf_counter()
    for _ in Recording(path).chunks():
        pass
    chunked = time.perf_counter()
    print(
        f"reads of {size:5d} B: write {volume / (written - began) / 1e6:5.0f} MB/s, "
        f"buffers {volume / (read - written) / 1e6:5.0f} MB/s, "
        f"chunks {volume / (chunked - read) / 1e6:5.0f} MB/s, "
        f"packed to {path.stat().st_size / volume:.2f}"
    )


def record_for_ever(path: str) -> None:
    """Record at the pace of a device at its fastest, and print what was handed over, and when."""
    recorder = Recorder(Path(path), {})
    data = frames(20_000)
    began = time.monotonic()
    number = 0
    while True:
        size = int(LIVE_BYTES_PER_S * READ_S)
        start = number * size % (len(data) - size)
        recorder.rx(Chunk(time.monotonic_ns(), data[start : start + size]))
        number += 1
        print(number, time.monotonic_ns(), flush=True)
        time.sleep(max(0.0, began + number * READ_S - time.monotonic()))


def kill(folder: Path, trial: int) -> float:
    """Kill a recording process at a random moment; return the seconds lost."""
    path = folder / f"kill{trial}.mcap"
    command = [sys.executable, "-c", CHILD, str(path)]
    here = Path(__file__).parent
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=here) as child:
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(random.Random(trial).uniform(2.0, 5.0))
        child.send_signal(signal.SIGKILL)
        handed = [int(line.split()[1]) for line in child.stdout if line.count(" ") == 1]
    kept = [chunk.host_ns for chunk in Recording(path).chunks()]
    return (handed[-1] - kept[-1]) * 1e-9


def flip(folder: Path, trials: int) -> None:
    """Flip one byte of a minute's recording at random places; print what is lost."""
    data = frames(30_000)
    chunks = list(reads(data, 932, 60 * LIVE_BYTES_PER_S))
    path = folder / "flip.mcap"
    writer = SessionWriter(path, {})
    for number, chunk in enumerate(chunks, 1):
        writer.chunk(chunk)
        if number % round(COMMIT_S / READ_S) == 0:
            writer.commit()
    writer.close()
    whole = path.read_bytes()
    source = random.Random(0)
    lost = []
    for _ in range(trials):
        position = source.randrange(len(whole))
        torn = bytearray(whole)
        torn[position] ^= 1 << source.randrange(8)
        path.write_bytes(torn)
        lost.append(len(chunks) - sum(1 for chunk in Recording(path).chunks() if chunk.data))
    seconds = np.array(lost) * 0.01
    print(
        f"one flipped bit in a minute, {trials} times: median {np.median(seconds):.2f} s lost, "
        f"most {seconds.max():.2f} s, nothing in {np.mean(seconds == 0):.0%}"
    )


def main() -> None:
    """Run all and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--megabytes", type=int, default=100)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--flips", type=int, default=50)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for size in (93, 465, 932, 4096):
            speed(folder, size, options.megabytes * 1_000_000)
        lost = [kill(folder, trial) for trial in range(options.kills)]
        print(f"killed {len(lost)} times: lost {min(lost):.2f} to {max(lost):.2f} s")
        flip(folder, options.flips)


if __name__ == "__main__":
    main()
