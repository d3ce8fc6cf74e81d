"""Run live sessions in which any output may fail, from seeds, and see that what is left adds up.

    python benchmarks/fault_simulation.py [--seeds 2000] [--first 0]

See `tests/support/fault_simulation.py` for what fails, `fault_invariants.py` for what must hold. A
seed that is printed fails again with ``--first SEED --seeds 1``. Exit code 1 if any does.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.fault_invariants import simulate
from support.fault_simulation import Plan


def main() -> int:
    """Run the seeds and print those that fail."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--seeds", type=int, default=2000)
    options.add_argument("--first", type=int, default=0)
    asked = options.parse_args()
    failed, began = 0, time.process_time()
    with tempfile.TemporaryDirectory() as place:
        for seed in range(asked.first, asked.first + asked.seeds):
            if wrong := simulate(seed, Path(place)):
                failed += 1
                print(Plan.of(seed), *wrong, sep="\n    ", flush=True)
    took = time.process_time() - began
    print(f"{failed} of {asked.seeds} seeds failed; {took:.0f} s of processor time")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
