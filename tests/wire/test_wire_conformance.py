"""The conformance kit: streams beyond the happy path, and a decoder in JavaScript beside ours."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from allanscope.samples import Block, Event, Gap, StreamInfo, Ticks
from allanscope.wire import Command
from allanscope.wire.native import NativeDecoder, NativeEncoder

KIT = Path(__file__).parents[2] / "firmware_protocol" / "conformance"
VECTORS = json.loads((KIT / "vectors.json").read_text())
NODE = shutil.which("node")

needs_node = pytest.mark.skipif(
    NODE is None, reason="no node: the decoder in JavaScript is not run beside this one"
)


def told(wire: bytes, batch: bool = True) -> dict[str, Any]:
    """Return what this decoder tells of a stream, in the words of the kit."""
    decoder = NativeDecoder(batch)
    events = [_plain(one) for one in decoder.feed(wire, 0.0)]
    events = [one for one in events if one is not None]
    merged: list[dict[str, Any]] = []
    for one in events:
        last = merged[-1] if merged else {}
        if "counts" in one and last.get("index", -1) + len(last.get("counts", ())) == one["index"]:
            last["counts"] += one["counts"]
            last["times"] += one["times"]
        else:
            merged.append(one)
    stats = decoder.stats
    counters = {
        "frames": stats.frames,
        "damaged": stats.crc_errors + stats.resyncs,
        "unknown": stats.unknown,
        "samples": stats.samples,
        "lost": stats.lost_samples,
        "unknown_losses": stats.unknown_losses,
    }
    return {"events": merged, "counters": counters}


def _plain(event: Event) -> dict[str, Any] | None:
    if isinstance(event, StreamInfo):
        axes, scale = list(event.axes), list(event.scale)
        return {"epoch": event.epoch, "axes": axes, "scale": scale, "rate": event.nominal_hz}
    if isinstance(event, Gap):
        return {"lost": event.lost, "reason": event.reason}
    if isinstance(event, Block):
        times = [None if np.isnan(one) else one for one in event.ticks.device_s.tolist()]
        return {"index": event.index, "counts": event.counts.tolist(), "times": times}
    return _said(event.kind, event.text, dict(event.fields))


def _said(kind: str, text: str, fields: dict[str, Any]) -> dict[str, Any] | None:
    """Return what the device says beside its samples; None for remarks of the decoder's own."""
    told = {"time": fields.pop("uptime_s", None)}
    if "produced" in fields:
        return {"status": told | fields}
    if kind == "reply":
        return {"reply": {**told, "seq": fields.pop("sequence"), **fields}}
    return {"event": told | fields | {"text": text}} if "level" in fields else None


def in_javascript(wires: list[bytes]) -> list[dict[str, Any]]:
    """Return what the decoder in JavaScript tells of streams."""
    cases = json.dumps([{"wire": wire.hex()} for wire in wires])
    assert NODE
    ran = subprocess.run(
        [NODE, str(KIT / "decoder.js")],
        input=cases,
        capture_output=True,
        text=True,
        check=True,
        timeout=100,
    )
    found: list[dict[str, Any]] = json.loads(ran.stdout)
    return found


def test_the_vectors_are_those_that_their_script_writes() -> None:
    ran = subprocess.run(
        [sys.executable, str(KIT / "make_vectors.py")], capture_output=True, text=True, check=True
    )
    assert json.loads(ran.stdout) == VECTORS
    assert len({one["name"] for one in VECTORS}) == len(VECTORS) >= 30


@pytest.mark.parametrize("batch", [True, False])
@pytest.mark.parametrize("vector", VECTORS, ids=[one["name"] for one in VECTORS])
def test_a_vector_is_told_as_it_must_be(vector: dict[str, Any], batch: bool) -> None:
    found = told(bytes.fromhex(vector["wire"]), batch)
    assert found["events"] == vector["events"]
    assert found["counters"]["damaged"] == vector["damaged"]
    assert found["counters"]["unknown"] == vector["unknown"]


@needs_node
def test_the_decoder_in_javascript_tells_the_vectors_the_same() -> None:
    wires = [bytes.fromhex(one["wire"]) for one in VECTORS]
    for vector, wire, found in zip(VECTORS, wires, in_javascript(wires), strict=True):
        assert found["events"] == vector["events"], vector["name"]
        assert found == told(wire), vector["name"]


def _device(rng: np.random.Generator) -> list[bytes]:
    """Return the frames of a simulated device: two epochs, drops, and frames of all other types."""
    encoder, frames = NativeEncoder(), []
    for epoch in (7, 8):
        axes = ("gx", "gy", "gz", "ax", "ay", "az")[: int(rng.choice([3, 6]))]
        scale = tuple(0.00875 if axis[0] == "g" else 6.1e-5 for axis in axes)
        info = StreamInfo(axes, scale, 416.0, "LSM6DSM", "native", 1e-6, True, epoch)
        index = 0
        for number in range(40):
            if number % 12 == 0:
                frames.append(encoder.describe(info))
                frames.append(encoder.status(index, index, 0, number * 0.1))
                frames.append(encoder.event(f"at {index}", number * 0.1, int(rng.integers(3))))
                asked = Command(
                    rng.choice(["ping", "start"]), number, {"payload": b"", "type": 0x85}
                )
                frames.append(encoder.reply(asked, bool(rng.integers(2))))
            n = int(rng.integers(1, 19))
            counts = rng.integers(-300, 300, (n, len(axes))).astype(np.int16)
            times = np.array([index / 416.0]), np.array([np.nan]), np.array([25.0])
            frames.append(encoder.encode(Block(index, counts, Ticks(np.array([0]), *times))))
            index += n + int(rng.choice([0, 0, 0, 5]))
    return frames


def _damaged(frames: list[bytes], rng: np.random.Generator) -> bytes:
    """Lose, repeat and swap whole frames, then flip, lose and insert bytes."""
    kept = [frame for frame in frames for _ in range(int(rng.choice([0, 1, 1, 1, 1, 1, 1, 2])))]
    data = bytearray(b"\0" * int(rng.integers(2)) + b"".join(kept))
    for _ in range(int(rng.integers(0, 30))):
        at = int(rng.integers(len(data)))
        match int(rng.integers(4)):
            case 0:
                data[at] ^= 1 << int(rng.integers(8))
            case 1:
                del data[at : at + int(rng.choice([1, 2, 60, 300]))]
            case 2:
                data[at:at] = rng.bytes(int(rng.choice([1, 5, 300])))
            case 3:
                data[at] = 0
    return bytes(data)


@needs_node
def test_both_decoders_tell_the_same_of_damaged_streams() -> None:
    rng = np.random.default_rng(2)
    wires = [_damaged(_device(rng), rng) for _ in range(150)]
    lost, said = 0, {"status": 0, "event": 0, "reply": 0}
    for wire, found in zip(wires, in_javascript(wires), strict=True):
        expected = json.loads(json.dumps(told(wire)))
        assert found == expected
        lost += expected["counters"]["lost"]
        for kind in said:
            said[kind] += sum(kind in one for one in expected["events"])
    assert lost > 10_000
    assert min(said.values()) > 500, said
