"""A process that is killed while it records loses what had gathered since the last commit."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from allanscope.recording import Recording

CHILD = """
import sys, time
from pathlib import Path
from allanscope.recording import Chunk, Recorder

recorder = Recorder(Path(sys.argv[1]), {"part": "LSM6DSM"}, commit_s=0.2)
number = 0
while True:
    number += 1
    recorder.rx(Chunk(time.monotonic_ns(), number.to_bytes(4, "little") * 100))
    print(f"{number} {time.monotonic_ns()}", flush=True)
    time.sleep(0.005)
"""

SCHEDULING_S = 3.0
"""What a busy machine may add: a bound for a stuck writer, not a measurement."""


@pytest.mark.parametrize("seed", range(4))
def test_kill_loses_only_the_time_between_two_commits(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "session.mcap"
    command = [sys.executable, "-c", CHILD, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        child.stdout.readline()
        time.sleep(random.Random(seed).uniform(0.3, 0.9))
        child.send_signal(signal.SIGKILL)
        # The kill may have cut the last line.
        handed = [line.split() for line in child.stdout if line.endswith("\n")]
    recording = Recording(path)
    numbers = [int.from_bytes(chunk.data[:4], "little") for chunk in recording.chunks()]
    assert numbers == list(range(1, len(numbers) + 1))
    assert recording.metadata["part"] == "LSM6DSM"
    assert "never closed" in recording.damage[-1].what or "truncated" in recording.damage[-1].what
    times = {int(number): int(host_ns) for number, host_ns in handed}
    last_handed = max(times)
    lost_s = (times[last_handed] - times.get(len(numbers), min(times.values()))) * 1e-9
    assert lost_s < 0.2 + SCHEDULING_S
