"""MATLAB's ``.mat``, as SciPy reads it: arrays and structures of them, called as those of ``.npz``.

A field of a structure counts as an array of its own name; MATLAB's rows and columns are turned as
needed. A single axis may be called by its sensor alone (``omega``), as in MATLAB's own example.
"""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.pipeline.table_files import (
    MATLAB_4_BYTES,
    MOST_BYTES,
    MOST_MEMBERS,
    TableFile,
    matlab_4_header,
)
from allanscope.pipeline.table_files.arrays import Found, columns_of_found, sort_in
from allanscope.recording import most_unpacked

__all__ = ["read"]

_HEADER_BYTES = 128
_ORDER_AT = 126
_PACKED = 15
"""Type of an element that is compressed."""
_PIECE = 1 << 20
_DEEPEST = 4
_WIDTHS = {0: 8, 1: 4, 2: 4, 3: 2, 4: 2, 5: 1}
"""Bytes of a number of version 4."""
_SPARSE = 2


def read(path: Path, stream: str = "") -> TableFile:
    """Return the samples of a ``.mat`` of version 4 to 7."""
    with path.open("rb") as file:
        magic = file.read(10)
    if magic == b"MATLAB 7.3":
        raise ValueError(
            "a .mat of version 7.3, which is HDF5; in MATLAB load it and save it with -v7"
        )
    if magic.startswith(b"MATLAB"):
        _refuse_bombs(path)
    else:
        _refuse_claims(path)
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError, MatReadWarning

    try:
        # Only numbers, texts and structures: a function handle is never made one.
        with warnings.catch_warnings():
            # Objects, such as MATLAB's timetables and strings, have no names: SciPy's "None" twice.
            warnings.simplefilter("ignore", MatReadWarning)
            content = loadmat(path, simplify_cells=True, appendmat=False)
    except (MatReadError, TypeError, KeyError, IndexError, UnicodeError) as error:
        raise ValueError(f"not a valid .mat file: {error}") from None
    found = Found()
    for number, (name, array) in enumerate(_arrays(content)):
        if number == MOST_MEMBERS:
            raise ValueError(f"more than {MOST_MEMBERS} arrays")
        sort_in(found, name, array)
    return TableFile(columns_of_found(found), "mat", found.rate_hz)


def _refuse_bombs(path: Path) -> None:
    """Raise ValueError for elements that unpack to more than fits in memory."""
    most = min(MOST_BYTES, most_unpacked(path.stat().st_size))
    left = most
    with path.open("rb") as file:
        order = "<" if file.read(_HEADER_BYTES)[_ORDER_AT:] == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(order + "II", tag)
            following = file.tell() + size
            unpack = zlib.decompressobj()
            while kind == _PACKED and not unpack.eof:
                packed = unpack.unconsumed_tail or file.read(min(_PIECE, following - file.tell()))
                if not packed:
                    break
                left -= len(unpack.decompress(packed, _PIECE))
                if left < 0:
                    raise ValueError(f"more than {most} bytes of arrays")
            file.seek(following)


def _refuse_claims(path: Path) -> None:
    """Raise ValueError for matrices of version 4 that claim to be more than the file has."""
    left = path.stat().st_size
    number = 0
    with path.open("rb") as file:
        while head := file.read(MATLAB_4_BYTES):
            if len(head) < MATLAB_4_BYTES:
                raise ValueError("a truncated .mat of version 4")
            header = matlab_4_header(head)
            if header is None:
                raise ValueError("a .mat of version 4 with a matrix that is none")
            if header.kind % 10 == _SPARSE:
                raise ValueError("a .mat of version 4 with a sparse matrix")
            numbers = header.rows * header.columns * (1 + header.is_complex)
            size = header.name_bytes + numbers * _WIDTHS[header.kind // 10]
            left -= MATLAB_4_BYTES + size
            if left < 0:
                raise ValueError("a truncated .mat of version 4")
            number += 1
            if number > MOST_MEMBERS:
                raise ValueError(f"more than {MOST_MEMBERS} arrays")
            file.seek(size, 1)


def _arrays(content: Mapping[str, Any], depth: int = 0) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the arrays of numbers and of texts by name, those of structures among them."""
    for name, value in content.items():
        if name.startswith("__"):
            continue
        if isinstance(value, dict) and depth < _DEEPEST:
            yield from _arrays(value, depth + 1)
            continue
        array = np.asarray(value)
        if array.dtype.kind == "O" and all(isinstance(one, str) for one in array.flat):
            array = array.astype(str)
        if array.dtype.kind not in "iufU":
            continue
        if array.ndim == 2 and array.shape[0] < array.shape[1]:
            array = array.T
        yield name, array.astype(array.dtype.newbyteorder("="), copy=False)
