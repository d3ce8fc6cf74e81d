"""What may stand between this machine and a measurement, and the command that fixes it."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from allanscope.compiled import LibraryMissing
from allanscope.errors import AllanscopeError, UsageError
from allanscope.pipeline.read_queue import LIVE_ROOM
from allanscope.quantities import duration
from allanscope.sources import buffers, find_ports, may_run_in_real_time
from allanscope.view import has_display

__all__ = ["Check", "machine_checks"]

_ENOUGH_BYTES = 2_000_000_000
"""Two days at the highest rate, with the charts."""
_ENOUGH_PER_S = 5e6
"""Some fifty times what the fastest sensor sends."""
_SAMPLE_BYTES = 14.1
"""Of the native format, with the share of its frame."""
_ENOUGH_S = 0.1
"""Of a port that is not read; a busy machine keeps a reader waiting for as long."""
_PROBE = 1 << 20
_PROBES = 16


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was looked at.

    Attributes
    ----------
    grade : {'ok', 'note', 'bad'}
        ``note`` where something will not work that not everybody needs.
    name, text : str
        What was looked at, and what was seen.
    remedy : str
        The command that fixes it, or what else to do; empty where nothing is to be done.
    """

    grade: Literal["ok", "note", "bad"]
    name: str
    text: str
    remedy: str = ""

    def __str__(self) -> str:
        line = f"{self.grade:<4}  {self.name}: {self.text}"
        return f"{line}\n      -> {self.remedy}" if self.remedy else line


def machine_checks(folder: Path, rate_hz: float) -> Iterator[Check]:
    """Yield what was seen of ports, viewer, compiled code and disk, one after the other.

    Parameters
    ----------
    folder : Path
        Where sessions are to be written.
    rate_hz : float
        Sample rate in Hz for which the buffers are judged.
    """
    yield from _ports()
    yield from _reading(rate_hz)
    modem_manager = _modem_manager()
    if modem_manager is not None:
        yield modem_manager
    yield _viewer()
    yield _graphics()
    yield _compiled()
    yield _disk(folder)


def _ports() -> Iterator[Check]:
    ports = find_ports()
    if not any(port.kind for port in ports):
        there = ", ".join(port.device for port in ports) or "no serial port at all"
        yield Check(
            "note",
            "board",
            f"no SensorTile and no ST-LINK; found: {there}",
            "plug the board in; without one: allanscope live sim",
        )
    for port in ports:
        if os.access(port.device, os.R_OK | os.W_OK) or sys.platform == "win32":
            yield Check("ok", "port", str(port))
            continue
        group = _group(Path(port.device))
        remedy = f"sudo usermod -aG {group} $USER, then log in again" if group else ""
        yield Check("bad", "port", f"no permission to open {port.device}", remedy)


def _reading(rate_hz: float) -> Iterator[Check]:
    """Check for how long samples wait without loss, and whether the reader may go first."""
    if not 0.0 < rate_hz < 1e9:
        raise UsageError(f"{rate_hz:g} Hz is not a sample rate")
    if not sys.platform.startswith("linux"):
        yield Check("ok", "buffers", "not checked on this system")
        return
    per_s = rate_hz * _SAMPLE_BYTES
    held = buffers()
    in_system_s = held["the system"] / per_s
    then = ", ".join(
        f"{duration(size / per_s)} in {who}"
        for who, size in (("the reader", held["the reader"]), ("the measuring process", LIVE_ROOM))
    )
    yield Check(
        "ok" if in_system_s > _ENOUGH_S else "note",
        "buffers",
        f"samples can wait {1e3 * in_system_s:.0f} ms in the system, {then} "
        f"(at {rate_hz:g} Hz, {per_s / 1e3:.0f} kB/s: native format, six axes)",
        "" if in_system_s > _ENOUGH_S else "a lower rate, if samples are lost beside other work",
    )
    if may_run_in_real_time():
        yield Check("ok", "reader", "may run at real-time priority")
        return
    yield Check(
        "note",
        "reader",
        "may not run at real-time priority: a busy machine can keep it waiting",
        'echo "$USER - rtprio 10" | sudo tee /etc/security/limits.d/allanscope.conf, then log in '
        "again; or install rtkit",
    )


def _group(port: Path) -> str:
    """Return the group of a port; empty where there is none to join."""
    try:
        return port.group()
    except (OSError, KeyError, NotImplementedError):
        return ""


def _modem_manager(processes: Path = Path("/proc")) -> Check | None:
    """Check whether ModemManager runs, which asks every new port whether it is a modem."""
    if not processes.is_dir():
        return None
    for file in processes.glob("[0-9]*/comm"):
        try:
            if file.read_text("utf-8").strip() == "ModemManager":
                return Check(
                    "note",
                    "ModemManager",
                    "runs, and holds a port for some seconds after the board is plugged in",
                    "sudo systemctl disable --now ModemManager, or the udev rule of "
                    "docs/how-to/ports.md",
                )
        except (OSError, ValueError):
            continue
    return Check("ok", "ModemManager", "not running")


def _viewer() -> Check:
    if importlib.util.find_spec("rerun_cli") is None:
        remedy = f"{Path(sys.executable).name} -m pip install rerun-sdk; analyse needs none"
        return Check("bad", "viewer", "Rerun is not installed", remedy)
    where = (
        "opens a window"
        if has_display()
        else "no display: the charts are served as a web page (--view web)"
    )
    return Check("ok", "viewer", where)


def _graphics(devices: Path = Path("/dev/dri"), drivers: Path = Path("/usr/share/vulkan")) -> Check:
    """Check whether a window can be drawn; the web viewer needs nothing of this machine."""
    if not sys.platform.startswith("linux"):
        return Check("ok", "GPU", "not checked on this system")
    if any(devices.glob("renderD*")):
        return Check("ok", "GPU", "there is one")
    if any((drivers / "icd.d").glob("*")):
        return Check("ok", "GPU", "none; software rendering")
    return Check(
        "note",
        "GPU",
        "neither a GPU nor a software driver for the viewer's window",
        "sudo apt-get install libvulkan1 mesa-vulkan-drivers; or use --view web",
    )


def _compiled() -> Check:
    """Run one kernel: whatever is wrong with the compiled code shows here."""
    began = time.monotonic()
    try:
        import numpy as np

        from allanscope.allan import AllanBank

        AllanBank(100.0, axes=1).update(np.zeros((64, 1)))
    except LibraryMissing as error:
        return Check("bad", "compiled code", error.problem, error.remedy)
    except Exception as error:
        return Check(
            "bad",
            "compiled code",
            f"does not run: {type(error).__name__}: {error}",
            f"{Path(sys.executable).name} -m pip install --force-reinstall allanscope",
        )
    return Check("ok", "compiled code", f"ready after {time.monotonic() - began:.1f} s")


def _disk(folder: Path) -> Check:
    """Write some megabytes to the disk, as a recorder would, and remove them."""
    try:
        free = shutil.disk_usage(folder).free
        with tempfile.TemporaryFile(dir=folder) as file:
            began = time.monotonic()
            for _ in range(_PROBES):
                file.write(bytes(_PROBE))
                file.flush()
                os.fsync(file.fileno())
            per_s = _PROBES * _PROBE / (time.monotonic() - began)
    except (OSError, AllanscopeError) as error:
        remedy = "choose a folder that can be written to with --out"
        why = getattr(error, "strerror", None) or error
        return Check("bad", "disk", f"cannot write to {folder.resolve()}: {why}", remedy)
    text = f"{per_s / 1e6:.0f} MB/s, {free / 1e9:.1f} GB free in {folder.resolve()}"
    if free < _ENOUGH_BYTES or per_s < _ENOUGH_PER_S:
        return Check("note", "disk", text, "choose another disk with --out")
    return Check("ok", "disk", text)
