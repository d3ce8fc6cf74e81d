"""Documents that are nearly right: JSON and TOML with values swapped, or their text damaged."""

from __future__ import annotations

import copy
import json
from typing import Any

import numpy as np

STRANGE: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**63, -(2**70), 10**400, 1e308, 5e-324, -0.0,
    float("nan"), float("inf"), -float("inf"), "", "0", "nan", "1e400", "gx", "\0", "ü\n",
    "step", "step:", "step:size=1,size", "x" * 300, [], {}, [[]], [None], {"": None}, ["gx", "gx"],
    {"value": None}, {"value": "x"}, {"value": {"value": 1}}, {"kind": "step"}, {"max": "x"},
)  # fmt: skip
"""Values that a reader may not expect where they stand."""


def mutant(document: Any, rng: np.random.Generator) -> Any:
    """Return a copy of a document of mappings and lists with one to three places changed."""
    changed = copy.deepcopy(document)
    for _ in range(int(rng.integers(1, 4))):
        places = list(_places(changed))
        if not places:
            break
        holder, key = places[int(rng.integers(len(places)))]
        strange = copy.deepcopy(STRANGE[int(rng.integers(len(STRANGE)))])
        match int(rng.integers(5)):
            case 0:
                del holder[key]
            case 1 if isinstance(holder, dict):
                holder[str(strange)] = holder.pop(key)
            case 2:
                other, from_key = places[int(rng.integers(len(places)))]
                holder[key] = copy.deepcopy(other[from_key])
            case _:
                holder[key] = strange
    return changed


def damaged_text(text: str, rng: np.random.Generator) -> bytes:
    """Return text with bytes changed, lost and doubled."""
    out = bytearray(text.encode())
    for _ in range(int(rng.integers(1, 5))):
        at, end = sorted(int(x) for x in rng.integers(0, len(out) + 1, 2))
        match int(rng.integers(4)):
            case 0 if at < len(out):
                out[at] = int(rng.integers(256))
            case 1:
                del out[at : min(end, at + 20)]
            case 2:
                out[at:at] = out[at : min(end, at + 40)]
            case _:
                out[at:at] = b'[]{},:"=0\n.-e\xff'[int(rng.integers(13)) :][:1]
        out = out or bytearray(b"x")
    return bytes(out)


def json_text(document: Any) -> str:
    """Return a document as JSON as Python writes it, NaN included."""
    return json.dumps(document, indent=1)


def toml_text(document: dict[str, Any]) -> str:
    """Return a mapping of mappings as TOML; what TOML does not have is written as in JSON."""
    lines = []
    for title, table in document.items():
        if not isinstance(table, dict):
            lines.insert(0, f"{json.dumps(title)} = {_toml(table)}")
            continue
        lines.append(f"[{json.dumps(title)}]")
        lines += [f"{json.dumps(name)} = {_toml(value)}" for name, value in table.items()]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        inner = ", ".join(f"{json.dumps(name)} = {_toml(one)}" for name, one in value.items())
        return "{ " + inner + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return json.dumps(value)


def _places(document: Any) -> Any:
    """Yield every place that holds a value, with its holder."""
    items = ()
    if isinstance(document, dict):
        items = tuple(document.items())
    elif isinstance(document, list):
        items = tuple(enumerate(document))
    for key, value in items:
        yield document, key
        yield from _places(value)
