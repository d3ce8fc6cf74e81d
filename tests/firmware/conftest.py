"""Builds of the C encoder: as a library to call, and with sanitizers to run."""

import ctypes
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from emulator import Boards

ENCODER = Path(__file__).parents[2] / "firmware_protocol" / "encoder"
STRICT = [
    "-std=c99",
    "-O2",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wshadow",
    "-Werror",
]


@pytest.fixture(scope="session")
def compiler():
    """Return the host's C compiler."""
    found = shutil.which("gcc") or shutil.which("cc")
    if found is None:
        pytest.skip("no C compiler on this machine; install gcc")
    return found


@pytest.fixture(scope="session")
def encoder(compiler, tmp_path_factory):
    """Return the encoder as a library."""
    library = tmp_path_factory.mktemp("encoder") / "encoder.so"
    sources = sorted(str(path) for path in ENCODER.glob("*.c"))
    subprocess.run(
        [compiler, *STRICT, "-fPIC", "-shared", "-o", str(library), *sources], check=True
    )
    loaded = ctypes.CDLL(str(library))
    for name in ("as_cobs_encode", "as_cobs_decode"):
        getattr(loaded, name).restype = ctypes.c_size_t
        getattr(loaded, name).argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_char_p]
    loaded.as_crc32.restype = ctypes.c_uint32
    loaded.as_crc32.argtypes = [ctypes.c_char_p, ctypes.c_size_t]
    return loaded


@pytest.fixture(scope="session")
def firmware(tmp_path_factory):
    """Return the folder of the firmware built for the board."""
    for tool, package in (("arm-none-eabi-gcc", "gcc-arm-none-eabi"), ("make", "make")):
        if shutil.which(tool) is None:
            pytest.skip(f"no {tool} on this machine; install {package}")
    out = tmp_path_factory.mktemp("firmware")
    subprocess.run(["make", "-s", "-C", str(ENCODER.parent / "device"), f"OUT={out}"], check=True)
    return out


@pytest.fixture(scope="session")
def boards(firmware, tmp_path_factory):
    """Return what starts emulated boards."""
    qemu = shutil.which("qemu-system-arm")
    if qemu is None:
        pytest.skip("no qemu-system-arm on this machine; install version 10 of qemu-system-arm")
    machines = subprocess.run([qemu, "-M", "help"], capture_output=True, text=True, check=True)
    if "b-l475e-iot01a" not in machines.stdout:
        pytest.skip("this QEMU has no b-l475e-iot01a; version 10 has")
    return Boards(firmware, tmp_path_factory.mktemp("boards"))
