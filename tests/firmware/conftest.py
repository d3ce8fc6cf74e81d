"""Builds of the C encoder: as a library to call, and with sanitizers to run."""

import ctypes
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from support.emulator import Boards

SANITIZE = "ALLANSCOPE_SANITIZE"
"""Name of the variable that holds more flags for the library."""

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
def library(compiler, tmp_path_factory):
    """Return the driver of the real part and the device around it; sanitized when asked to be."""
    out = tmp_path_factory.mktemp("driver") / "driver.so"
    device = ENCODER.parent / "device"
    names = ("lsm6dsm", "lsm6dsm_self_test", "imu", "device", "descriptor")
    sources = [*(device / f"{name}.c" for name in names), *ENCODER.glob("*.c")]
    flags = [*STRICT, f"-I{ENCODER}", "-fPIC", "-shared", *os.environ.get(SANITIZE, "").split()]
    subprocess.run([compiler, *flags, "-o", str(out), *map(str, sources)], check=True)
    return ctypes.CDLL(str(out))


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
