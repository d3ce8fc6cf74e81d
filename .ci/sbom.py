"""Write the bill of materials of the installed program to standard output, as CycloneDX 1.5.

    python .ci/sbom.py > build/sbom.json

It names what `pip install allanscope` brings here, with versions and licences, extras left out.
"""

from __future__ import annotations

import json
import re
import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

PROJECT = tomllib.loads(
    Path(__file__).parents[1].joinpath("pyproject.toml").read_text(encoding="utf-8")
)["project"]


def plain(requirement: str) -> str:
    """Return the normal name of what is required."""
    found = re.match(r"[A-Za-z0-9._-]+", requirement)
    return re.sub(r"[-_.]+", "-", found[0]).lower() if found else ""


def needed() -> dict[str, dict[str, object]]:
    """Return the packages, by name."""
    found: dict[str, dict[str, object]] = {}
    waiting = [plain(one) for one in PROJECT["dependencies"]]
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        try:
            here = distribution(name)
        except PackageNotFoundError:  # asked for on other systems
            continue
        licence = here.metadata["License-Expression"] or here.metadata["License"] or ""
        found[name] = {
            "type": "library",
            "name": name,
            "version": here.version,
            "purl": f"pkg:pypi/{name}@{here.version}",
            "licenses": [{"license": {"name": licence.partition("\n")[0][:80] or "unknown"}}],
        }
        waiting += [plain(one) for one in here.requires or () if "extra ==" not in one]
    return found


if __name__ == "__main__":
    main = {"type": "application", "name": PROJECT["name"], "version": PROJECT["version"]}
    components = sorted(needed().values(), key=lambda one: str(one["name"]))
    bill = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": main},
        "components": components,
    }
    print(json.dumps(bill, indent=1))
