"""Compile the loops: ``python src/allanscope/compiled/build.py``, or by `hatch_build.py` for pip.

The compiler is what ``CC`` names; else Zig's, which pip brings (``pip install ziglang``) and which
compiles for every system on any; else the ``cc`` of this machine. It imports nothing of allanscope,
which cannot be loaded before this is done.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

__all__ = ["build", "fingerprint", "library_name", "wheel_platform"]

HERE = Path(__file__).parent

FLAGS = (
    *("-std=c99", "-O3", "-g0", "-fPIC", "-fvisibility=hidden"),
    # The same bits from every compiler and on every processor: nothing fused, nothing reordered.
    *("-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fno-sanitize=undefined"),
)

LEVELS = {"x86_64": {1: "x86-64", 3: "x86-64-v3", 4: "x86-64-v4"}}
"""Processors that a library is compiled for, by architecture; `processor.c` chooses."""

_OLDEST = {"linux": "2.17", "macos": "11.0"}
"""C library, and system, that a wheel asks for."""


def fingerprint() -> str:
    """Return what tells whether a library was compiled from these sources, in this way."""
    digest = hashlib.sha256()
    for path in sorted([*HERE.glob("*.[ch]"), HERE / "build.py"]):
        digest.update(path.name.encode() + b"\0" + path.read_bytes().replace(b"\r\n", b"\n"))
    return digest.hexdigest()[:16]


def library_name() -> str:
    """Return the name of the library's file on this system."""
    return "library." + {"windows": "dll", "macos": "dylib"}.get(_system(), "so")


def wheel_platform() -> str:
    """Return the platform of a wheel that holds what `build` makes here."""
    arch = _architecture()
    if _system() == "windows":
        return {"x86_64": "win_amd64", "aarch64": "win_arm64"}[arch]
    if _system() == "macos":
        return f"macosx_11_0_{arch.replace('aarch64', 'arm64')}"
    if not _is_zig(_compiler()):
        return sysconfig.get_platform().replace("-", "_").replace(".", "_")
    libc = "musllinux_1_2" if _musl() else "manylinux_2_17"
    return f"{libc}_{arch}"


def build(folder: Path) -> Path:
    """Compile the library into a folder and return its path.

    Raises
    ------
    subprocess.CalledProcessError
        Where the compiler fails; it has said why.
    """
    command = _compiler()
    zig = _is_zig(command)
    with tempfile.TemporaryDirectory() as temporary:
        room = Path(temporary)
        environment = {
            **{f"ZIG_{kind}_CACHE_DIR": str(room / "zig") for kind in ("LOCAL", "GLOBAL")},
            **os.environ,
        }

        def run(*arguments: str) -> None:
            subprocess.run([*command, *arguments], env=environment, check=True)

        target = ("-target", _zig_target()) if zig else ()
        objects = [str(room / "processor.o")]
        sources = f"-DSOURCES={fingerprint()}"
        run(*target, *FLAGS, sources, "-c", str(HERE / "processor.c"), "-o", objects[0])
        for level, name in LEVELS.get(_architecture(), {1: ""}).items():
            objects.append(str(room / f"v{level}.o"))
            chosen = f"-mcpu={name.replace('-', '_')}" if zig else f"-march={name}"
            processor = [chosen] if name else []
            if level == 4:
                processor.append("-mprefer-vector-width=512")
            library = (f"-DLEVEL=v{level}", "-c", str(HERE / "library.c"), "-o", objects[-1])
            run(*target, *FLAGS, *processor, *library)
        made = room / library_name()
        run(*target, "-shared", "-s", *objects, "-o", str(made), *(["-lm"] * (os.name != "nt")))
        # Another process may have the old one loaded: it keeps its file, a new one takes the place.
        folder.mkdir(parents=True, exist_ok=True)
        beside = folder / f".{made.name}.{os.getpid()}"
        shutil.copyfile(made, beside)
        return beside.replace(folder / made.name)


def _compiler() -> list[str]:
    if os.environ.get("CC"):
        return shlex.split(os.environ["CC"])
    if find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    if found := shutil.which("cc"):
        return [found]
    raise SystemExit("no C compiler: pip install ziglang, or name one in CC")


def _is_zig(command: list[str]) -> bool:
    return "zig" in Path(command[0]).name or "ziglang" in command


def _system() -> str:
    return {"win32": "windows", "darwin": "macos"}.get(sys.platform, "linux")


def _architecture() -> str:
    name = sysconfig.get_platform().rpartition("-")[2]
    return {"amd64": "x86_64", "arm64": "aarch64"}.get(name, name)


def _musl() -> bool:
    return "musl" in (sysconfig.get_config_var("HOST_GNU_TYPE") or "")


def _zig_target() -> str:
    system = _system()
    if system == "linux":
        system = "linux-musl" if _musl() else f"linux-gnu.{_OLDEST['linux']}"
    elif system == "macos":
        system = f"macos.{_OLDEST['macos']}"
    else:
        system = "windows-gnu"
    return f"{_architecture()}-{system}"


def _is_up_to_date() -> bool:
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(str(HERE / library_name()))
        library.sources.restype = ctypes.c_char_p
        return bool(library.sources().decode() == fingerprint())
    return False


if __name__ == "__main__":
    if not _is_up_to_date():
        print(build(HERE))
