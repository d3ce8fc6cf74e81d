"""Two builds of the wheel are the same bytes, and the bill of materials names what it needs."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NEEDED = ("src", "README.md", "LICENSE", "pyproject.toml", "hatch_build.py")


def built(room: Path, mtime: int, umask: str) -> str:
    """Return the fingerprint of a wheel that is built from a copy of the sources."""
    room.mkdir()
    skipped = shutil.ignore_patterns("__pycache__", "*.so", "*.dylib", "*.dll")
    for name in NEEDED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, room / name, ignore=skipped)
        else:
            shutil.copy(source, room / name)
    for path in room.rglob("*"):
        os.utime(path, (mtime, mtime))
    command = f'umask {umask}; exec "$0" -m hatchling build -t wheel -d made'
    ran = subprocess.run(
        ["sh", "-c", command, sys.executable],
        cwd=room,
        env={**os.environ, "CC": "cc", "SOURCE_DATE_EPOCH": "1700000000"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    (wheel,) = (room / "made").glob("*.whl")
    return hashlib.sha256(wheel.read_bytes()).hexdigest()


@pytest.mark.skipif(shutil.which("cc") is None, reason="no compiler cc")
def test_the_wheel_is_the_same_bytes_wherever_it_is_built(tmp_path: Path) -> None:
    pytest.importorskip("hatchling")
    one = built(tmp_path / "one", 1_600_000_000, "022")
    assert one == built(tmp_path / "another place", 1_700_000_000, "077")


def test_the_bill_of_materials_names_every_dependency() -> None:
    ran = subprocess.run(
        [sys.executable, str(ROOT / ".ci" / "sbom.py")], capture_output=True, text=True, check=True
    )
    bill = json.loads(ran.stdout)
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.5")
    named = {one["name"]: one for one in bill["components"]}
    assert {"numpy", "scipy", "rerun-sdk", "mcap"} <= named.keys()
    for name, one in named.items():
        assert one["purl"] == f"pkg:pypi/{name}@{one['version']}"
