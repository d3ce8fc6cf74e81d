"""Compile the C sources while a wheel is built, and put the library into it."""

from __future__ import annotations

import os
import runpy
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

COMPILED = Path("src", "allanscope", "compiled")


class CompiledLoops(BuildHookInterface):  # type: ignore[type-arg]
    """Build the library: beside its sources for an editable install, else for the wheel alone."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Return the compiler that pip is to bring, unless the user names one."""
        return [] if os.environ.get("CC") else ["ziglang>=0.13"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and give the wheel the tag of its platform."""
        sources = Path(self.root, COMPILED)
        made = runpy.run_path(str(sources / "build.py"))
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{made['wheel_platform']()}"
        if version == "editable":
            made["build"](sources)
            return
        self.room = tempfile.TemporaryDirectory()
        library = made["build"](Path(self.room.name))
        build_data["force_include"][str(library)] = f"allanscope/compiled/{library.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was compiled: the wheel has it."""
        if version != "editable":
            self.room.cleanup()
