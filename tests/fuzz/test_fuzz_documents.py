"""Specifications and results that are nearly right: taken, or refused in one line.

``python tests/fuzz/test_fuzz_documents.py 20000`` tries more than the tests do.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from allanscope.errors import AllanscopeError
from allanscope.pipeline.check import read_limits as read_specification
from allanscope.sanitize import sanitize
from allanscope.simulator import Simulator, Truth

sys.path.insert(0, str(Path(__file__).parents[1]))
from support.mutants import damaged_text, json_text, mutant, toml_text

NUMBER = {"value": 0.003, "lower": 0.002, "upper": 0.004, "detected": True, "unit": "dps"}
RESULT: dict[str, Any] = {
    "schema": "allanscope/1",
    "part": "LSM6DSM",
    "rate": {"nominal_hz": 104.0, "measured_hz": 102.5},
    "axes": {
        "gx": {
            "unit": "dps",
            "coefficients": {"N": NUMBER, "B": {**NUMBER, "detected": False}, "K": 1e-4},
            "level": {"mean": 0.2},
            "effects": [
                {"kind": "step", "parameters": {"time": {"value": 6.0}, "size": {"value": 0.1}}},
                {"kind": "unexplained", "parameters": {"frequency": 3.0}},
                "sinusoid:frequency=5,amplitude=0.01",
            ],
        },
        "az": {
            "unit": "g",
            "coefficients": {"N": 9e-5, "Q": None},
            "level": None,
            "effects": [
                {"kind": "cross_coupling", "parameters": {"source": "gx", "factor": 0.1}},
                {"kind": "repeated_samples", "axes": ["gx", "az"], "parameters": {"share": 0.1}},
            ],
        },
    },
}
SPECIFICATION: dict[str, Any] = {
    "gyro": {"N": 0.004, "B": {"max": 0.002}},
    "az": {"N": {"min": 1e-5, "max": 1e-4}, "K": 3},
}


def take_truth(path: Path) -> None:
    """Read a sensor, and take some samples of it."""
    Simulator(truth=Truth.load(path), duration_s=1.0).read(20)


KINDS: dict[str, tuple[dict[str, Any], Callable[[Any], str], Callable[[Path], object], str]] = {
    "truth as JSON": (RESULT, json_text, take_truth, "truth.json"),
    "truth as TOML": (RESULT, toml_text, take_truth, "truth.toml"),
    "specification": (SPECIFICATION, toml_text, read_specification, "spec.toml"),
}


def unexpected(kind: str, seeds: range, folder: Path) -> list[str]:
    """Return what went wrong in another way than with one line for people."""
    document, written, taken, name = KINDS[kind]
    path, wrong = folder / name, []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        text = written(mutant(document, rng))
        path.write_bytes(damaged_text(text, rng) if seed % 4 == 0 else text.encode())
        try:
            with np.errstate(all="ignore"):
                taken(path)
        except AllanscopeError as error:
            if "\n" in sanitize(str(error)):
                wrong.append(f"{seed}: more than one line: {error!r}")
        except Exception as error:
            wrong.append(f"{seed}: {type(error).__name__}: {error}")
    return wrong


@pytest.mark.parametrize("kind", KINDS)
def test_any_mutant_is_read_or_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    assert unexpected(kind, range(700), tmp_path) == []


if __name__ == "__main__":
    import tempfile

    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
    with tempfile.TemporaryDirectory() as place:
        for each in KINDS:
            found = unexpected(each, range(count), Path(place))
            print(f"{each}: {len(found)} of {count} unexpected")
            print("\n".join(found[:20]))
