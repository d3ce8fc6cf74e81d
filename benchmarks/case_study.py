"""The case study of docs/closing_the_loop.md, from the recording to numbers and pictures.

python benchmarks/case_study.py [recordings/measured/st-gyro-warmup.parquet]
[--figures docs/figures] [--again]

With --again what was found is simulated, and the loop is turned on the simulated sensor.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from allanscope.explain import AxisExplanation, Explanation, explain
from allanscope.explain.residual import deviation_of
from allanscope.history import Record
from allanscope.pipeline.table_files import table_of_file
from allanscope.simulator import Simulator, Truth

RATE_HZ = 100.0
RECORDING = Path(__file__).parents[1] / "recordings" / "measured" / "st-gyro-warmup.parquet"


def read(path: Path) -> Record:
    """Read the counts of the one axis."""
    columns = table_of_file(path).columns
    return as_record(columns.axes["gx"], columns.scales["gx"])


def as_record(counts: NDArray[np.integer], scale: float) -> Record:
    """Return counts of one axis as a record."""
    n = len(counts)
    return Record(
        rate_hz=RATE_HZ,
        stride=1,
        axes=("gx",),
        values=(counts * scale)[:, np.newaxis],
        lsb=(scale,),
        temperature_c=np.full(n, np.nan),
        start_s=np.arange(n) / RATE_HZ,
        segments=np.array([[0, n]], np.int64),
    )


def print_numbers(result: Explanation) -> None:
    """Print what was found, and the error before and after."""
    axis = result.axes["gx"]
    print_effects(axis)
    print("\n| | before | after |\n|---|---|---|")
    for name in (
        "chi2_per_dof", "p_value", "rms_percent", "expected_rms_percent", "worst_band_z",
    ):  # fmt: skip
        print(f"| {name} | {getattr(axis.before, name):.3g} | {getattr(axis.after, name):.3g} |")
    for letter in "QNBKR":
        before, after = axis.coefficients_before[letter], axis.coefficients_after[letter]
        cells = [
            f"{c.value:.3g} ({c.lower:.3g} .. {c.upper:.3g})" if c.detected else f"< {c.upper:.3g}"
            for c in (before, after)
        ]
        print(f"| {letter} [{before.unit}] | {cells[0]} | {cells[1]} |")
    print(f"| held-out nats | | {axis.held_out_nats:.0f} +- {axis.held_out_nats_se:.0f} |")
    print(f"\nexplained: {axis.explained}")


def print_effects(axis: AxisExplanation) -> None:
    """Print the effects with their parameters."""
    for effect in axis.effects:
        print(f"- {effect.kind}: {effect.evidence['words']}")
        for name, p in effect.parameters.items():
            limits = f" ({p.lower:.5g} .. {p.upper:.5g})" if p.lower is not None else ""
            print(f"    {name} = {p.value:.5g}{limits} {p.unit}")


def simulate_again(record: Record, axis: AxisExplanation) -> None:
    """Simulate a sensor that has what was found, and print what the loop finds in it."""
    found = {
        "coefficients": {
            letter: {"value": c.value, "detected": c.detected}
            for letter, c in axis.coefficients_after.items()
        },
        "effects": [
            {"kind": e.kind, "parameters": {name: p.value for name, p in e.parameters.items()}}
            for e in axis.effects
        ],
    }
    sensor = Simulator(
        rate=RATE_HZ, truth=Truth.from_result({"axes": {"gx": found}}), clock_error=0.0,
        axes=("gx",), gyro_fs=250.0, duration_s=len(record.values) / RATE_HZ,
    )  # fmt: skip
    counts = sensor.read(len(record.values)).counts[:, 0]
    again = explain(as_record(counts, sensor.info.scale[0])).axes["gx"]
    print("\nthe same loop on a simulated sensor that has these effects:\n")
    print_effects(again)
    print(f"\nexplained: {again.explained}")


def print_series(record: Record, result: Explanation) -> None:
    """Print how much the level still moves when seconds are averaged."""
    raw, cleaned = searched(record, result)
    white = result.axes["gx"].coefficients_after["N"].value
    print("\n| rms about the mean, in dps | before | after | white noise alone |")
    print("|---|---|---|---|")
    for seconds in (1.0, 10.0, 100.0):
        before, after = (averaged(values, seconds)[1].std() for values in (raw, cleaned))
        alone = white / seconds**0.5
        print(f"| {seconds:.0f} s means | {before:.4f} | {after:.4f} | {alone:.4f} |")


def searched(
    record: Record, result: Explanation
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the samples as measured and as left over; a few at the end are not searched."""
    cleaned = result.cleaned["gx"]
    return record.values[: len(cleaned), 0], cleaned


def averaged(
    values: NDArray[np.float64], seconds: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Average over so many seconds."""
    size = int(seconds * RATE_HZ)
    whole = len(values) // size * size
    means = values[:whole].reshape(-1, size).mean(axis=1)
    return (np.arange(len(means)) + 0.5) * seconds, means


def draw(record: Record, result: Explanation, folder: Path) -> None:
    """Draw the curve before and after, and the series with what was taken out of it."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    raw, cleaned = searched(record, result)
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True)
    parts = (
        ("five textbook terms", raw, result.models_before["gx"]),
        ("after the loop", cleaned, result.models_after["gx"]),
    )
    for panel, (title, values, model) in zip(axes, parts, strict=True):
        curve = deviation_of(values, RATE_HZ)
        panel.fill_between(curve.tau, curve.lower, curve.upper, alpha=0.25, lw=0)
        panel.loglog(curve.tau, curve.deviation, "o", ms=3, label="measured")
        panel.loglog(curve.tau, model.deviation("oadev", curve.m), "k", lw=1, label="model")
        panel.set(title=title, xlabel="averaging time in s")
        panel.grid(alpha=0.3, which="both", lw=0.4)
    axes[0].set_ylabel("Allan deviation in dps")
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(folder / "case_study_curves.png", dpi=110)
    plt.close(figure)

    figure, axes = plt.subplots(2, 1, figsize=(10, 5), sharex=True)
    for panel, values in zip(axes, (raw, cleaned), strict=True):
        panel.plot(*averaged(values, 5.0), lw=0.7)
        panel.grid(alpha=0.3, lw=0.4)
        panel.set_ylabel("rate in dps, 5 s means")
    deterministic = raw - cleaned
    shift = raw.mean() - deterministic.mean()
    axes[0].plot(*averaged(deterministic + shift, 1.0), "k", lw=1)
    axes[0].set_title("as measured, with the warm-up and the excursions that the loop found")
    axes[1].set(title="without them", xlabel="time in s")
    figure.tight_layout()
    figure.savefig(folder / "case_study_series.png", dpi=110)
    plt.close(figure)


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("recording", nargs="?", type=Path, default=RECORDING)
    parser.add_argument("--figures", type=Path)
    parser.add_argument("--again", action="store_true")
    arguments = parser.parse_args()
    record = read(arguments.recording)
    result = explain(record)
    print_numbers(result)
    print_series(record, result)
    if arguments.figures:
        draw(record, result, arguments.figures)
    if arguments.again:
        simulate_again(record, result.axes["gx"])


if __name__ == "__main__":
    main()
