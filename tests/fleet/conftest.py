"""Short recordings of simulated boards, written once for all tests of a process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from allanscope.recording import Chunk, write_recording
from allanscope.simulator import Simulator, Truth, simulate_blocks

RATE_HZ = 104.0
HOURS = 0.002
"""Seven seconds: 750 samples, enough for everything but good numbers."""


def write_board(path: Path, seed: int, effects: Sequence[str] = (), **facts: str) -> Path:
    """Record a simulated board for some seconds."""
    path.parent.mkdir(parents=True, exist_ok=True)
    truth = Truth.typical("LSM6DSM", seed).with_effects(effects)
    board = Simulator(
        "LSM6DSM",
        RATE_HZ,
        seed,
        truth=truth,
        gyro_fs=125.0,
        accel_fs=2.0,
        duration_s=HOURS * 3600.0,
    )
    blocks = simulate_blocks(HOURS, board, "native", start_ns=1, seed=seed)
    chunks = (Chunk(host_ns, data) for host_ns, data in blocks)
    return write_recording(path, chunks, {"name": "simulated", "wire": "native", **facts})


@pytest.fixture(scope="session")
def board() -> Callable[..., Path]:
    """Return the function that records a board."""
    return write_board


@pytest.fixture(scope="session")
def lot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two units, one of them with two runs, and a file that is no recording.

    Never written to by a test.
    """
    folder = tmp_path_factory.mktemp("lot")
    write_board(folder / "one" / "a.mcap", 1, serial_number="0001")
    write_board(folder / "one" / "b.mcap", 2, serial_number="0001")
    write_board(folder / "two" / "a.mcap", 3, serial_number="0002")
    (folder / "two" / "bad.mcap").write_bytes(b"this is no recording" * 10)
    return folder
