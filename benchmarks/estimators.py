"""What the estimators cost, beside allantools, in one run on one machine.

    python benchmarks/estimators.py [--quick] [--json FILE]

Times are process CPU seconds, the least of several repetitions; memory is the peak that numpy and
Python allocate beyond the input (tracemalloc, in a run of its own). The bank gets int16 samples of
one axis and keeps all ten streamed estimators at four taus an octave; allantools gets float64 and
one estimator at one tau an octave, with the names it has for them.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import allantools
import numpy as np
from allantools.realtime import oadev_realtime, ohdev_realtime, tdev_realtime
from figures import Figure

from allanscope import allan
from allanscope.allan import AllanBank

STREAMED = ("stdev", "ostdev", "adev", "oadev", "mdev", "tdev", "hdev", "ohdev", "totdev", "pdev")
KINDS = (*STREAMED, "mtotdev", "ttotdev", "htotdev", "theo1", "theobr", "theoh")
BOUND_NS = 12.6
"""OADEV, OHDEV and MDEV alone, if nothing but the arithmetic took time: docs/performance.md."""

LIVE = {"oadev": oadev_realtime, "ohdev": ohdev_realtime, "tdev": tdev_realtime}

Row = dict[str, Any]
Call = Callable[[], object]


def counts(n: int, axes: int = 1) -> np.ndarray:
    """Return int16 samples of a noisy, wandering accelerometer at 1 g."""
    rng = np.random.default_rng(1)
    slow = 0.02 * rng.standard_normal((n, axes)).cumsum(axis=0)
    return np.clip(16000 + 12 * rng.standard_normal((n, axes)) + slow, -32768, 32767).astype("i2")


def seconds(call: Call, repetitions: int) -> float:
    """Return the least CPU time of a call."""
    best = np.inf
    for _ in range(repetitions):
        start = time.process_time()
        call()
        best = min(best, time.process_time() - start)
    return best


def peak_bytes(call: Call) -> int:
    """Return the most memory that a call allocates at a time."""
    tracemalloc.start()
    call()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def banked(data: np.ndarray) -> AllanBank:
    """Return a bank that saw the data in blocks of 4096, as a pipeline would bring them."""
    bank = AllanBank(100.0, axes=data.shape[1])
    for start in range(0, len(data), 4096):
        bank.update(data[start : start + 4096])
    return bank


def measured(what: str, n: int, call: Call, repetitions: int, *, taus: int, kinds: int) -> Row:
    """Return one line of the table, for `kinds` estimators at once."""
    best = seconds(call, repetitions)
    return {
        "what": what,
        "n": n,
        "taus": taus,
        "seconds": best,
        "ns_per_sample": 1e9 * best / n,
        "ns_per_sample_tau_estimator": 1e9 * best / n / taus / kinds,
        "peak_mib": peak_bytes(call) / 2**20,
    }


def peer(kind: str, data: np.ndarray) -> tuple[int, Call]:
    """Return the number of octave taus and allantools' call for one axis."""
    taus = 2.0 ** np.arange(int(np.log2(len(data) / 3)) + 1)
    taus = taus[taus >= 2] if kind == "theo1" else taus
    rates = data[:, 0].astype(np.float64)
    function = getattr(allantools, kind)
    return taus.size, partial(function, rates, rate=1.0, data_type="freq", taus=taus)


def long_records(sizes: list[int], repetitions: int) -> list[Row]:
    """Time a whole record: the bank with all its estimators, allantools with one."""
    rows = []
    for n in sizes:
        data = counts(n)
        taus = banked(data).deviation("oadev").m.size
        kinds = len(STREAMED)
        call = partial(banked, data)
        bank = measured("bank: ten estimators", n, call, repetitions, taus=taus, kinds=kinds)
        rows.append(bank)
        for kind in ("oadev", "ohdev", "mdev", "totdev"):
            octaves, call = peer(kind, data)
            often = 1 if n > 1_000_000 else repetitions
            row = measured(f"allantools {kind}", n, call, often, taus=octaves, kinds=1)
            rows.append(row | {"ratio": row["seconds"] / bank["seconds"]})
    return rows


def realtime(n: int) -> list[Row]:
    """Time allantools' realtime classes, which take one sample at a time, beside the bank."""
    data = counts(n)
    phase = np.append(0.0, data[:, 0].cumsum(dtype=float))
    factors = banked(data).deviation("ohdev").m
    frames = np.array_split(data, n // 26)

    def stream() -> None:
        bank = AllanBank(100.0, axes=1)
        for frame in frames:
            bank.update(frame)

    def one_by_one(kind: str) -> None:
        live = LIVE[kind](afs=factors, tau0=1.0)
        for value in phase:
            live.add_phase(value)

    taus = factors.size
    bank = measured("bank in frames of 26", n, stream, 3, taus=taus, kinds=len(STREAMED))
    rows = [bank]
    for kind in LIVE:
        call = partial(one_by_one, kind)
        row = measured(f"allantools realtime {kind}", n, call, 1, taus=taus, kinds=1)
        rows.append(row | {"ratio": row["seconds"] / bank["seconds"]})
    return rows


def totals(peer_sizes: list[int], own_sizes: list[int]) -> list[Row]:
    """Time the estimators that allantools does in N^2, octave taus, as far as each can go."""
    rows = []
    for kind in ("mtotdev", "htotdev", "theo1"):
        for n in own_sizes:
            spent = seconds(partial(fresh_query, banked(counts(n)), kind), 3)
            rows.append({"what": f"bank: one query of {kind}", "n": n, "seconds": spent})
        for n in peer_sizes:
            data = counts(n)
            whole = seconds(partial(allan.deviation, data[:, 0], 1.0, kind), 3)
            rows.append({"what": f"allanscope {kind}, every window", "n": n, "seconds": whole})
            octaves, call = peer(kind, data)
            spent = seconds(call, 1)
            row = {"what": f"allantools {kind}", "n": n, "taus": octaves, "seconds": spent}
            years = spent * (1e7 / n) ** 2 / 3.156e7
            rows.append(row | {"ratio": spent / whole, "years_for_1e7_as_square": years})
    return rows


def fresh_query(bank: AllanBank, *kinds: str) -> None:
    """Evaluate curves; the gap makes the bank forget what it has evaluated before."""
    bank.gap()
    for kind in kinds:
        bank.deviation(kind)


def queries(n: int) -> list[Row]:
    """Time every curve of six axes, and weigh the bank."""
    bank = banked(counts(n, axes=6))
    fresh_query(bank, *KINDS)
    rows = []
    for kind in KINDS:
        spent = seconds(partial(fresh_query, bank, kind), 3)
        rows.append({"what": f"query of {kind}, six axes", "n": n, "seconds": spent})
    spent = seconds(partial(fresh_query, bank, *KINDS), 3)
    rows.append({"what": "query of all sixteen, six axes", "n": n, "seconds": spent})
    rows.append({"what": "state per axis, KiB", "n": n, "kib": bank.nbytes / 6 / 1024})
    return rows


COLUMNS = {
    "taus": ("taus", "{:d}"),
    "seconds": ("CPU s", "{:.5f}"),
    "ns_per_sample": ("ns/sample", "{:.1f}"),
    "ns_per_sample_tau_estimator": ("ns/tau/kind", "{:.3f}"),
    "peak_mib": ("peak MiB", "{:.1f}"),
    "ratio": ("ratio", "{:.1f}"),
    "years_for_1e7_as_square": ("1e7: years", "{:.2g}"),
    "kib": ("KiB", "{:.0f}"),
}
"""Heading and format of each figure."""


def table(rows: list[Row]) -> str:
    """Return the rows as text, with the columns that any of them has."""
    columns = {key: value for key, value in COLUMNS.items() if any(key in row for row in rows)}
    lines = [" " * 34 + f"{'N':>10}" + "".join(f"{head:>13}" for head, _ in columns.values())]
    for row in rows:
        cells = [form.format(row[key]) if key in row else "" for key, (_, form) in columns.items()]
        lines.append(f"{row['what']:34}{row['n']:>10}" + "".join(f"{cell:>13}" for cell in cells))
    return "\n".join(lines)


def figures_of(sections: dict[str, list[Row]]) -> list[Figure]:
    """Return what goes to the common table: the longest record of each kind."""

    def last(section: str, what: str) -> Row:
        return next(row for row in reversed(sections[section]) if row["what"].startswith(what))

    bank, peer_row = last("long records", "bank"), last("long records", "allantools oadev")
    live, peer_live = last("sample by sample", "bank"), last("sample by sample", "allantools")
    found = [
        Figure(
            "ten streamed estimators, 4 taus an octave",
            bank["ns_per_sample"],
            "ns/sample",
            goal=30.0,
            peer=peer_row["ns_per_sample"],
            peer_name="allantools oadev, octaves",
            bound=BOUND_NS,
        ),
        Figure(
            "the same in frames of 26",
            live["ns_per_sample"],
            "ns/sample",
            peer=peer_live["ns_per_sample"],
            peer_name="allantools realtime",
        ),
        Figure("state per axis", sections["queries"][-1]["kib"], "KiB", goal=1024.0),
    ]
    for kind in ("mtotdev", "htotdev", "theo1"):
        row = last("totals", f"bank: one query of {kind}")
        found.append(Figure(f"{kind} of {row['n']:.0e} samples", row["seconds"], "s", goal=10.0))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="short records, a few seconds")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows to a file too")
    arguments = parser.parse_args()
    quick = arguments.quick
    for kind in ("mtotdev", "htotdev", "theo1"):
        allan.deviation(counts(500)[:, 0], 1.0, kind)
    sections = {
        "long records": long_records([100_000] if quick else [10**5, 10**6, 10**7], 3),
        "sample by sample": realtime(3000 if quick else 20_000),
        "totals": totals(
            [100] if quick else [100, 300, 1000], [10**5] if quick else [10**5, 10**6, 10**7]
        ),
        "queries": queries(100_000 if quick else 10**6),
    }
    for title, rows in sections.items():
        print(f"\n{title}\n{table(rows)}")
    if arguments.json:
        machine = {
            "machine": platform.processor() or platform.machine(),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "allantools": allantools.__version__,
        }
        figures = [asdict(figure) for figure in figures_of(sections)]
        content = {"machine": machine, "figures": figures, **sections}
        arguments.json.write_text(json.dumps(content, indent=1))


if __name__ == "__main__":
    main()
