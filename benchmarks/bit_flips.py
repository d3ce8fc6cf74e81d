"""What a format lets through when bits flip: false rows, before and after the neighbours are asked.

    python benchmarks/bit_flips.py [--rates 1e-4 1e-3 1e-2] [--samples 20000] [--formats text ...]

A simulated sensor at rest, its frames with single bits inverted at random, and a decoder. ``hit``
counts the samples in whose bytes a bit was inverted; ``false`` the delivered rows that nobody sent.
``before`` is the same decoder without `allanscope.wire.plausibility`. ``sound suspect`` are rows
left out as suspect although they were sent so. The last line feeds the real recordings of a folder
and rows with steps, shocks, saturation and outliers to the criterion as if their line were damaged.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from unittest import mock

import numpy as np

from allanscope.samples import Block, StreamInfo
from allanscope.simulator import Simulator
from allanscope.wire import WireSettings, format_named, formats
from allanscope.wire.plausibility import Plausibility

FRAME_ROWS = 8


def frames(wire: str, samples: int, rate: float, gyro_fs: float) -> list[tuple[bytes, int]]:
    """Return what a device sends, with the number of samples in each piece."""
    encoder = format_named(wire).encoder()
    sensor = Simulator(rate=rate, seed=7, gyro_fs=gyro_fs)
    per = max(encoder.samples_per_frame(rate), 1)
    sent = [(encoder.describe(sensor.info), 0)]
    for _ in range(samples // per):
        sent.append((encoder.encode(sensor.read(per)), per))
    return sent


def flipped(data: bytes, rng: np.random.Generator, rate: float) -> bytes:
    """Return data with single bits inverted at a rate per byte."""
    out = bytearray(data)
    for at in np.flatnonzero(rng.random(len(out)) < rate):
        out[at] ^= 1 << int(rng.integers(8))
    return bytes(out)


def delivered(wire: str, pieces: list[bytes]) -> tuple[list[tuple[float, ...]], object]:
    """Return the rows that come out, in dps and g, and the counters."""
    decoder = format_named(wire).decoder(WireSettings())
    events = [event for piece in pieces for event in decoder.feed(piece, 0.0)] + decoder.finish()
    rows: list[tuple[float, ...]] = []
    scale = np.ones(1)
    for event in events:
        if isinstance(event, StreamInfo):
            scale = np.asarray(event.scale)
        elif isinstance(event, Block):
            rows += map(tuple, np.round(event.counts * scale, 6).tolist())
    return rows, decoder.stats


def line(wire: str, rate: float, samples: int) -> str:
    """Return one line of the table."""
    gyro_fs = 250.0
    sent = frames(wire, samples, 104.0, gyro_fs)
    truth = set(delivered(wire, [data for data, _ in sent])[0])
    rng = np.random.default_rng(3)
    pieces, hit = [sent[0][0]], 0
    for data, count in sent[1:]:
        # The first rows decide on the meaning: that is another question.
        other = flipped(data, rng, rate) if len(pieces) * max(count, 1) > 100 else data
        hit += count * (other != data)
        pieces.append(other)
    rows, stats = delivered(wire, pieces)
    with mock.patch.object(Plausibility, "note_damage"):
        unjudged, _ = delivered(wire, pieces)
    before = sum(row not in truth for row in unjudged)
    after = sum(row not in truth for row in rows)
    sound = sum(row in truth for row in unjudged) - sum(row in truth for row in rows)
    return f"| {wire} | {rate:g} | {hit} | {before} | {after} | {stats.suspect} | {sound} |"


def suspects(rows: np.ndarray) -> int:
    """Return how many rows would be suspect if their line were a damaged one."""
    follower = Plausibility()
    found = 0
    for start in range(0, len(rows), 1000):
        piece = rows[start : start + 1001]
        found += int(follower.isolated(piece)[:1000].sum())
        follower.update(piece[:1000])
    return found


def main() -> None:
    """Print the tables."""
    options = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    options.add_argument("--rates", type=float, nargs="+", default=[1e-4, 1e-3, 1e-2])
    options.add_argument("--samples", type=int, default=20_000)
    options.add_argument("--formats", nargs="+", default=list(formats()))
    options.add_argument("--recordings", type=Path, help="folder of tables: .npz, .csv.gz, .txt.gz")
    asked = options.parse_args()
    print("| format | flips per byte | hit | false before | after | suspect | sound ones lost |")
    print("|---|---|---|---|---|---|---|")
    for wire in asked.formats:
        for rate in asked.rates:
            print(line(wire, rate, asked.samples), flush=True)
    if asked.recordings:
        recordings(asked.recordings)


def recordings(folder: Path) -> None:
    """Print how many rows of real recordings the criterion would take."""
    import gzip

    print("\n| recording | rows | suspect if the line were damaged |\n|---|---|---|")
    for path in sorted(folder.rglob("*.*z")):
        if path.suffix == ".npz":
            with np.load(path) as held:
                tables = [held[name] for name in held.files]
            tables = [t.reshape(len(t), -1) for t in tables if t.dtype.kind in "iuf" and t.ndim]
            found = [(name, t) for name, t in zip(held.files, tables, strict=False)]
        else:
            decoder = format_named("text").decoder(WireSettings())
            events = decoder.feed(gzip.decompress(path.read_bytes()), np.nan) + decoder.finish()
            blocks = [event.counts for event in events if isinstance(event, Block)]
            found = [("", np.concatenate(blocks))] if blocks else []
        for name, table in found:
            print(f"| {path.name} {name} {table.shape} | {len(table)} | {suspects(table)} |")


if __name__ == "__main__":
    main()
