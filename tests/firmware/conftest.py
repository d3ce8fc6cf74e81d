"""Builds of the C encoder: as a library to call, and with sanitizers to run."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import pytest

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
