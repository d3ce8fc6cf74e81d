"""What a recording costs and what a crash costs it.

    python benchmarks/recording.py [--megabytes 200] [--kills 50] [--damages 50]

Measures, on noise in frames like those of the native wire format: writing and reading speed and
packed size at several sizes of a read; what a process that is killed with SIGKILL at a random
moment loses at the pace of 6 axes at 6.66 kHz; what a flipped bit, a cut at any byte, a tail of
zeros and a disk that is full for a while cost.
"""

from __future__ import annotations

import argparse
import errno
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from allanscope.recording import (
    Chunk,
    Recorder,
    Recording,
    SessionWriter,
    segment,
    write_recording,
)
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


def minute(folder: Path) -> tuple[Path, bytes, int]:
    """Record a minute as a live session does; return the file, its bytes and its reads."""
    chunks = list(reads(frames(30_000), 932, 60 * LIVE_BYTES_PER_S))
    path = folder / "minute.mcap"
    writer = SessionWriter(path, {})
    for number, chunk in enumerate(chunks, 1):
        writer.chunk(chunk)
        if number % round(COMMIT_S / READ_S) == 0:
            writer.commit()
    writer.close()
    return path, path.read_bytes(), len(chunks)


def flipped(whole: bytes, source: random.Random) -> tuple[bytes, float]:
    torn = bytearray(whole)
    torn[source.randrange(len(whole))] ^= 1 << source.randrange(8)
    return bytes(torn), 0.0


def cut(whole: bytes, source: random.Random) -> tuple[bytes, float]:
    at = source.randrange(1000, len(whole))
    return whole[:at], 1.0 - at / len(whole)


def zeroed(whole: bytes, source: random.Random) -> tuple[bytes, float]:
    at = source.randrange(1000, len(whole))
    return whole[:at] + bytes(len(whole) - at), 1.0 - at / len(whole)


def damage(folder: Path, trials: int) -> None:
    """Damage a minute's recording at random places; print what is lost beyond what is gone."""
    path, whole, count = minute(folder)
    for name, harm in (
        ("one flipped bit", flipped),
        ("cut at a random byte", cut),
        ("zeros from a random byte on", zeroed),
    ):
        source = random.Random(0)
        lost = []
        for _ in range(trials):
            torn, gone = harm(whole, source)
            path.write_bytes(torn)
            kept = sum(1 for chunk in Recording(path).chunks() if chunk.data)
            lost.append((count - kept) * READ_S - 60.0 * gone)
        seconds = np.maximum(lost, 0.0)
        print(
            f"{name}, {trials} times in a minute: lost beyond what is gone {np.median(seconds):.2f}"
            f" s (median), {seconds.max():.2f} s (most)"
        )


def full_disk(folder: Path) -> None:
    """Let the disk refuse everything for three seconds; print what that costs."""
    path, began = folder / "full.mcap", time.monotonic()
    write = segment._write_all  # noqa: SLF001

    def refusing(fd: int, data: bytearray) -> None:
        if 1.0 < time.monotonic() - began < 4.0:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(fd, data)

    segment._write_all = refusing  # noqa: SLF001
    told: list[float] = []
    recorder = Recorder(path, {}, on_alarm=lambda _: told.append(time.monotonic() - began))
    handed = slowest = 0.0
    data = frames(20_000)
    size = int(LIVE_BYTES_PER_S * READ_S)
    while time.monotonic() - began < 5.0:
        before = time.monotonic()
        recorder.rx(Chunk(time.monotonic_ns(), data[:size]))
        slowest = max(slowest, time.monotonic() - before)
        handed += 1
        time.sleep(READ_S)
    recorder.close()
    segment._write_all = write  # noqa: SLF001
    kept = sum(1 for chunk in Recording(path).chunks() if chunk.data)
    print(
        f"a disk that is full from 1 s to 4 s: told after {told[0] - 1.0:.2f} s, "
        f"{handed - kept:.0f} of {handed:.0f} reads lost, no read held up longer than "
        f"{1e3 * slowest:.1f} ms"
    )


def main() -> None:
    """Run all and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--megabytes", type=int, default=100)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--damages", type=int, default=50, help="of each sort")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for size in (93, 465, 932, 4096):
            speed(folder, size, options.megabytes * 1_000_000)
        lost = [kill(folder, trial) for trial in range(options.kills)]
        print(
            f"killed {len(lost)} times: lost {min(lost):.2f} to {max(lost):.2f} s, "
            f"median {np.median(lost):.2f} s"
        )
        damage(folder, options.damages)
        full_disk(folder)


if __name__ == "__main__":
    main()
