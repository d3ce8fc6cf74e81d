"""Fail if an installed dependency has a known advisory; skip aloud where nobody can be asked.

    python .ci/audit.py

pip-audit asks for advisories over the network. Where it cannot be installed, gets no answer or
takes longer than `PATIENCE_S`, a line says that nothing was audited, and the exit code is 0.
"""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
import tempfile
from pathlib import Path

PATIENCE_S = 120.0


def answer() -> str | None:
    """Return what pip-audit says as JSON; None where it says nothing."""
    bill = runpy.run_path(str(Path(__file__).with_name("sbom.py")))
    lines = [f"{one['name']}=={one['version']}" for one in bill["needed"]().values()]
    with tempfile.TemporaryDirectory() as room:
        pinned = Path(room) / "requirements.txt"
        pinned.write_text("\n".join(lines) + "\n", encoding="utf-8")
        install = [sys.executable, "-m", "pip", "install", "-q", "--target", f"{room}/audit"]
        audit = [sys.executable, "-m", "pip_audit", "--no-deps", "--disable-pip", "-f", "json"]
        try:
            subprocess.run(
                [*install, "pip-audit"], capture_output=True, timeout=PATIENCE_S, check=True
            )
            return subprocess.run(
                [*audit, "--timeout", "15", "-r", str(pinned)],
                env={**os.environ, "PYTHONPATH": f"{room}/audit"},
                capture_output=True,
                text=True,
                timeout=PATIENCE_S,
                check=False,
            ).stdout
        except (OSError, subprocess.SubprocessError):
            return None


def main() -> int:
    """Return 1 if there is an advisory."""
    try:
        audited = json.loads(answer() or "")["dependencies"]
    except (ValueError, KeyError, TypeError):
        print("audit of dependencies: SKIPPED, the index of advisories cannot be reached")
        return 0
    known = [(one, each) for one in audited for each in one.get("vulns", ())]
    for one, each in known:
        print(f"{one['name']} {one['version']}: {each['id']}, fixed in {each['fix_versions']}")
    print(f"audit of dependencies: {len(audited)} packages, {len(known)} advisories")
    return 1 if known else 0


if __name__ == "__main__":
    raise SystemExit(main())
