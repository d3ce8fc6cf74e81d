"""What a run leaves behind: the result as JSON and the report as HTML, each whole or not at all."""

from __future__ import annotations

import json
import os
import re
import time
from pathlib import Path

from allanscope.analysis.result import Analysis
from allanscope.errors import UsageError

__all__ = [
    "new_session_folder",
    "report_sessions",
    "session_folder",
    "write_json",
    "write_report",
    "write_whole",
]


def write_json(analysis: Analysis, path: Path) -> None:
    """Write the result in the schema ``allanscope/1``."""
    write_whole(path, json.dumps(analysis.to_dict(), indent=1, allow_nan=False) + "\n")


def write_report(analysis: Analysis, path: Path) -> None:
    """Write the report of one session as one HTML file."""
    from allanscope.report.page import render

    write_whole(path, render(analysis))


def write_whole(path: Path, text: str) -> None:
    """Write a text file so that nobody ever sees half of it.

    Raises
    ------
    UsageError
        When the place cannot be written to.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise UsageError(f"cannot write {path}: {error.strerror}; choose another place") from None


def new_session_folder(device: str) -> Path:
    """Return a folder named after time and device that does not exist yet."""
    plain = re.sub(r"[^A-Za-z0-9]+", "-", device).strip("-")[-24:] or "device"
    return Path(time.strftime(f"session-%Y%m%d-%H%M%S-{plain}"))


def session_folder(path: Path) -> Path:
    """Make the folder of a session.

    Raises
    ------
    UsageError
        When it cannot be made or holds a session already: nothing is ever overwritten.
    """
    if any(path.glob("session*.mcap")):
        raise UsageError(
            f"{path} holds a session already; choose another folder, or --resume {path}"
        )
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot make the folder {path}: {error.strerror}") from None
    return path


def report_sessions(paths: list[Path], out: Path) -> Path:
    """Write the report of one session, or one that compares several; return its path."""
    from allanscope.pipeline.analyse import analyse_input
    from allanscope.pipeline.settings import DeviceSettings
    from allanscope.report.compare import render_comparison

    sessions = {str(path): analyse_input(path, DeviceSettings(), quiet=True) for path in paths}
    if len(sessions) == 1:
        write_report(next(iter(sessions.values())), out)
    else:
        write_whole(out, render_comparison(sessions))
    return out
