"""A bank as plain arrays: what a checkpoint or another process needs to go on from there.

The state is a dict of numpy arrays. One of them, ``header``, is JSON in UTF-8: format, version, and
type, shape and checksum of each of the others. No pickle; nothing in a state is ever executed.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["pack", "unpack"]

_FORMAT = "allanscope bank"
_VERSION = 2

State = dict[str, NDArray[Any]]


def pack(arrays: Mapping[str, NDArray[Any]]) -> State:
    """Return copies of the arrays and a header that describes them."""
    held = {name: np.array(array, order="C") for name, array in arrays.items()}
    header = {
        "format": _FORMAT,
        "version": _VERSION,
        "arrays": {name: _description(array) for name, array in held.items()},
    }
    return {"header": np.frombuffer(json.dumps(header).encode(), np.uint8).copy(), **held}


def unpack(state: Mapping[str, ArrayLike], like: Mapping[str, NDArray[Any]]) -> State:
    """Return copies of the arrays of a state.

    Parameters
    ----------
    state : mapping
        What `pack` returned.
    like : mapping
        Arrays of a new bank: their names, types and numbers of dimensions are required.

    Raises
    ------
    ValueError
        Where the header is not one of ours or an array is missing or not what the header says.
    """
    try:
        header = json.loads(np.asarray(state["header"], np.uint8).tobytes())
        found = header["format"], header["version"]
        described = dict(header["arrays"])
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise ValueError(
            f"this is no state of a bank: its header cannot be read: {error!r}"
        ) from None
    if found != (_FORMAT, _VERSION):
        raise ValueError(f"state is {found[0]!r} version {found[1]!r}; need {_FORMAT!r} {_VERSION}")
    arrays = {}
    for name, model in like.items():
        array = np.array(state.get(name, ()), order="C")
        sound = _description(array) == described.get(name)
        if not sound or array.dtype != model.dtype or array.ndim != model.ndim:
            raise ValueError(f"state of a bank is damaged: {name!r} is not what was saved")
        arrays[name] = array
    return arrays


def _description(array: NDArray[Any]) -> dict[str, Any]:
    return {
        "type": array.dtype.str,
        "shape": list(array.shape),
        "crc32": zlib.crc32(array.tobytes()),
    }
