"""A case study: a recording, what the loop finds in it, and the error before and after.

    python benchmarks/case_study.py recordings/measured/NAME.parquet [--axes gx,az]
        [--figures docs/figures] [--again]

Prints for each axis what was found, the coefficients beside a reading of N that owes nothing to
allanscope (`independent_reading.py`), and the error of the textbook model and of the final one: on
the record they were fitted to, and on each half of it by the models of the other half. With
--figures the curves, spectra and series are drawn; with --again what was found is simulated, and
the loop is turned on the simulated sensor. Missing rows are bridged as `allanscope analyse` does.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from independent_reading import Reading, density_of, reading_of, samples_of
from numpy.typing import NDArray

from allanscope.analysis import Analyser
from allanscope.analysis.analyser import loop_input
from allanscope.analysis.coefficients import published_coefficients
from allanscope.explain import AxisExplanation, Explanation, explain
from allanscope.explain.series import deviation_of
from allanscope.history import Record
from allanscope.noise import Coefficient, NoiseModel, gls_chi2
from allanscope.noise.gap_bridging import bridge_gaps
from allanscope.pipeline.analyse_arrays import events_of_columns
from allanscope.pipeline.settings import DeviceSettings
from allanscope.pipeline.table_files import table_of_file
from allanscope.simulator import Simulator, Truth

Array = NDArray[np.float64]

SMALL = {"g": (1e3, "m"), "a": (1e6, "u")}
"""Factor and prefix in which the noise of a gyro (dps) and of an accelerometer (g) is printed."""
NAMES = {
    "chi2_per_dof": "chi-square per degree of freedom",
    "rms_percent": "rms of measured / model - 1, %",
    "worst_band_z": "worst band of the spectrum, z",
}
HELD = ("2nd half, models of the 1st", "1st half, models of the 2nd")


@dataclass(frozen=True)
class HeldOut:
    """Error of the models of one half on the other half, as it was measured.

    Attributes
    ----------
    chi2, rms_percent : (float, float)
        Of the textbook model, and of the final one.
    sampling_percent : float
        The rms that sampling alone leaves.
    """

    chi2: tuple[float, float]
    rms_percent: tuple[float, float]
    sampling_percent: float


def read(path: Path) -> Record:
    """Return a recording as `analyse` hands it to the loop, short gaps bridged."""
    table = table_of_file(path)
    analyser = Analyser()
    for event in events_of_columns(table.columns, DeviceSettings(rate_hz=table.rate_hz)):
        analyser.feed(event)
    record = bridge_gaps(loop_input(analyser.state).record)
    if len(record.segments) > 1:
        raise SystemExit(f"{path}: {len(record.segments)} stretches; a case study needs one")
    return record


def rows_of(record: Record, rows: slice) -> Record:
    """Return some of the rows of a record without gaps."""
    values = record.values[rows]
    return replace(
        record,
        values=values,
        temperature_c=record.temperature_c[rows],
        start_s=record.start_s[rows] - record.start_s[rows][0],
        segments=np.array([[0, len(values)]]),
        filled=None if record.filled is None else record.filled[rows],
    )


def held_out_of(record: Record) -> dict[str, list[HeldOut]]:
    """Explain each half, and hold its models against the other half as it was measured.

    A line that was subtracted comes back, so its variance is added; what happens once (a step, a
    shock, a warm-up) cannot be foretold. The first of two is that of the first half's models.
    """
    middle = len(record.values) // 2
    halves = [rows_of(record, slice(0, middle)), rows_of(record, slice(middle, None))]
    held: dict[str, list[HeldOut]] = {axis: [] for axis in record.axes}
    for own, other in (halves, halves[::-1]):
        result = explain(own)
        for column, axis in enumerate(record.axes):
            if axis not in result.models_after:
                continue
            lines = [e.curve for e in result.axes[axis].effects if e.curve is not None]
            final = result.models_after[axis]
            final = NoiseModel((*final.components, *lines), final.dt, final.filters)
            curve = deviation_of(other.values[:, [column]], other.rate_hz).axis(0)
            before, after = (
                gls_chi2(curve, model, n=len(other.values), fitted=0)
                for model in (result.models_before[axis], final)
            )
            held[axis].append(
                HeldOut(
                    (before.chi2 / before.dof, after.chi2 / after.dof),
                    (before.rms_percent, after.rms_percent),
                    after.expected_rms_percent,
                )
            )
    return held


def print_axis(axis: str, result: Explanation, reading: Reading, held: list[HeldOut]) -> None:
    """Print what was found on one axis, its coefficients and its errors."""
    found = result.axes[axis]
    print(f"\n## {axis}: {'explained' if found.explained else 'not explained'}\n")
    if found.hindrance:
        print(found.hindrance)
        return
    print_effects(found)
    factor, prefix = SMALL[axis[0]]
    print("\n| | before | after |\n|---|---|---|")
    final = published_coefficients(axis, result.fits, result.axes)
    for letter in "QNBKR":
        before, after = found.coefficients_before[letter], final[letter]
        unit = f"{prefix}{before.unit}"
        print(f"| {letter} in {unit} | {_cell(before, factor)} | {_cell(after, factor)} |")
    print(
        f"\nN read from the density between {reading.band[0]:.3g} and {reading.band[1]:.3g} Hz: "
        f"{factor * reading.N:.3g} +- {factor * reading.N_error:.2g}; OADEV at 1 s "
        f"{factor * reading.oadev_1s:.3g}, least {factor * reading.least:.3g} "
        f"at {reading.least_at_s:.3g} s"
    )
    print("\n| error | before | after | sampling alone |\n|---|---|---|---|")
    expected = {"rms_percent": f"{found.after.expected_rms_percent:.1f}", "chi2_per_dof": "1"}
    for name, words in NAMES.items():
        before, after = getattr(found.before, name), getattr(found.after, name)
        print(f"| {words} | {before:.3g} | {after:.3g} | {expected.get(name, '')} |")
    for one, words in zip(held, HELD, strict=False):
        print(f"| chi-square of the {words} | {one.chi2[0]:.3g} | {one.chi2[1]:.3g} | 1 |")
        before, after = one.rms_percent
        print(
            f"| rms of the {words}, % | {before:.3g} | {after:.3g} | {one.sampling_percent:.1f} |"
        )
    print(
        f"\nheld-out log-likelihood gain of what has a name: {found.held_out_nats:.0f} +- "
        f"{found.held_out_nats_se:.0f} nats"
    )
    if shares := found.shares:
        print(
            f"of the excess of {shares.excess_nats:.0f} nats over sampling error "
            f"{shares.named:.1%} has a name, {shares.nameless:.1%} has none, {shares.left:.1%} "
            "is left"
        )
    for remark in found.remarks:
        print(f"remark: {remark}")


def _cell(one: Coefficient, factor: float) -> str:
    if not one.detected:
        return f"< {factor * one.upper:.3g}"
    return f"{factor * one.value:.3g} [{factor * one.lower:.3g}, {factor * one.upper:.3g}]"


def print_effects(axis: AxisExplanation) -> None:
    """Print the effects with their parameters."""
    for effect in axis.effects:
        share = "" if np.isnan(effect.share) else f" ({effect.share:.1%} of the excess)"
        print(f"- {effect.kind}: {effect.evidence['words']}{share}")
        for name, p in effect.parameters.items():
            limits = f" [{p.lower:.5g}, {p.upper:.5g}]" if p.lower is not None else ""
            value = p.value if isinstance(p.value, str) else f"{p.value:.5g}"
            print(f"    {name} = {value}{limits} {p.unit}".rstrip())


def print_means(record: Record, result: Explanation, axes: list[str]) -> None:
    """Print how much the level still moves when seconds are averaged."""
    print("\n| rms of means, before > after, and of white noise | 1 s | 10 s | 100 s |")
    print("|---|---|---|---|")
    for axis in axes:
        factor, prefix = SMALL[axis[0]]
        raw, cleaned = searched(record, result, axis)
        white = result.axes[axis].coefficients_after["N"].value
        cells = []
        for seconds in (1.0, 10.0, 100.0):
            if len(raw) < 4 * seconds * record.rate_hz:
                cells.append("")
                continue
            before, after = (
                factor * averaged(values, seconds, record.rate_hz)[1].std()
                for values in (raw, cleaned)
            )
            cells.append(f"{before:.3g} > {after:.3g}, {factor * white / seconds**0.5:.3g}")
        unit = prefix + ("dps" if axis[0] == "g" else "g")
        print(f"| {axis} in {unit} | {' | '.join(cells)} |")


def simulate_again(record: Record, result: Explanation) -> None:
    """Simulate a sensor that has what was found, and print what the loop finds in it."""
    found = {
        name: {
            "coefficients": {
                letter: {"value": c.value, "detected": c.detected}
                for letter, c in axis.coefficients_after.items()
            },
            "effects": [
                {"kind": e.kind, "parameters": {name: p.value for name, p in e.parameters.items()}}
                for e in axis.effects
            ],
        }
        for name, axis in result.axes.items()
    }
    sensor = Simulator(
        rate=record.rate_hz, truth=Truth.from_result({"axes": found}), clock_error=0.0,
        axes=record.axes, gyro_fs=250.0, duration_s=len(record.values) / record.rate_hz,
    )  # fmt: skip
    counts = sensor.read(len(record.values)).counts[:, : len(record.axes)]
    again = explain(
        replace(
            record, values=counts * np.asarray(sensor.info.scale), lsb=sensor.info.scale,
            filled=None, temperature_c=np.full(len(counts), np.nan),
        )
    )  # fmt: skip
    print("\nthe same loop on a simulated sensor that has these effects:")
    for name, axis in again.axes.items():
        print(f"\n{name}: {'explained' if axis.explained else 'not explained'}")
        print_effects(axis)


def searched(record: Record, result: Explanation, axis: str) -> tuple[Array, Array]:
    """Return the samples as measured and as left over; a few at the end are not searched."""
    cleaned = result.cleaned[axis]
    return record.values[: len(cleaned), record.axes.index(axis)], cleaned


def averaged(values: Array, seconds: float, rate_hz: float) -> tuple[Array, Array]:
    """Average over so many seconds."""
    size = max(1, int(seconds * rate_hz))
    whole = len(values) // size * size
    means = values[:whole].reshape(-1, size).mean(axis=1)
    return (np.arange(len(means)) + 0.5) * size / rate_hz, means


def draw(record: Record, result: Explanation, axes: list[str], path: Path) -> None:
    """Draw curves and spectra before and after, and the series with what was taken out."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(
        len(axes), 3, figsize=(11, 0.6 + 2.5 * len(axes)), squeeze=False, sharex="col"
    )
    for axis, (before, after, spectrum) in zip(axes, panels, strict=True):
        factor, prefix = SMALL[axis[0]]
        unit = prefix + ("dps" if axis[0] == "g" else "g")
        raw, cleaned = searched(record, result, axis)
        models = (result.models_before[axis], result.models_after[axis])
        for panel, values, model in zip((before, after), (raw, cleaned), models, strict=True):
            curve = deviation_of(values[:, np.newaxis], record.rate_hz).axis(0)
            limits = factor * curve.lower, factor * curve.upper
            panel.fill_between(curve.tau, *limits, alpha=0.25, lw=0)
            panel.loglog(curve.tau, factor * curve.deviation, "o", ms=3, label="measured")
            panel.loglog(
                curve.tau, factor * model.deviation("oadev", curve.m), "k", lw=1, label="model"
            )
        after.sharey(before)
        before.set_ylabel(f"{axis}: Allan deviation in {unit}")
        f, density = density_of(raw, record.rate_hz)
        spectrum.loglog(f, factor * np.sqrt(density / 2), lw=0.6, label="measured")
        for model, style, words in zip(models, ("C1--", "k"), ("textbook", "final"), strict=True):
            expected = factor * np.sqrt(model.density(f) / 2)
            spectrum.loglog(f, expected, style, lw=1.2, label=f"{words} model")
        spectrum.set_ylabel(f"{unit}/sqrt(Hz)")
    for panel in panels.ravel():
        panel.grid(alpha=0.3, which="both", lw=0.4)
    titles = ("five textbook terms", "after the loop", "root of half the density")
    for panel, title in zip(panels[0], titles, strict=True):
        panel.set_title(title)
        panel.legend(fontsize=7)
    for panel, label in zip(panels[-1], ("averaging time in s",) * 2 + ("Hz",), strict=True):
        panel.set_xlabel(label)
    figure.tight_layout()
    _save(figure, path.with_name(f"{path.name}_curves.png"))

    moved = [axis for axis in axes if result.signals[axis]]
    if not moved:
        return
    figure, panels = plt.subplots(
        len(moved),
        2,
        figsize=(11, 0.8 + 2.0 * len(moved)),
        squeeze=False,
        sharex=True,
        sharey="row",
    )
    seconds = len(record.values) / record.rate_hz / 480
    for axis, (before, after) in zip(moved, panels, strict=True):
        factor, prefix = SMALL[axis[0]]
        unit = prefix + ("dps" if axis[0] == "g" else "g")
        raw, cleaned = searched(record, result, axis)
        centre, signal = np.median(raw), raw - cleaned
        for panel, values in ((before, raw), (after, cleaned)):
            time_s, means = averaged(values - np.median(values), seconds, record.rate_hz)
            panel.plot(time_s, factor * means, lw=0.7)
            panel.grid(alpha=0.3, lw=0.4)
        time_s, means = averaged(
            signal - np.mean(signal) + np.mean(raw) - centre, seconds, record.rate_hz
        )
        before.plot(time_s, factor * means, "k", lw=0.9)
        before.set_ylabel(f"{axis} in {unit}")
    panels[0, 0].set_title(f"as measured, {seconds:.2g} s means, and what was found")
    panels[0, 1].set_title("without it")
    for panel in panels[-1]:
        panel.set_xlabel("time in s")
    figure.tight_layout()
    _save(figure, path.with_name(f"{path.name}_series.png"))


def _save(figure: Any, path: Path) -> None:
    """Write a figure with the few colours that it has."""
    from matplotlib import pyplot as plt
    from PIL import Image

    file = BytesIO()
    figure.savefig(file, dpi=80)
    plt.close(figure)
    Image.open(file).convert("RGB").quantize(64).save(path, optimize=True)


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--axes", type=lambda text: text.split(","), help="gx,az; all by default")
    parser.add_argument("--figures", type=Path, metavar="FOLDER")
    parser.add_argument("--again", action="store_true", help="simulate what was found as well")
    arguments = parser.parse_args()
    record = read(arguments.recording)
    result = explain(record)
    held = held_out_of(record)
    samples = samples_of(arguments.recording)
    filled = 0.0 if record.filled is None else record.filled.mean()
    print(
        f"{arguments.recording.stem}: {len(record.values)} rows at {record.rate_hz:.5g} Hz, "
        f"{len(record.values) / record.rate_hz:.1f} s, {filled:.1%} of them bridged"
    )
    for axis in arguments.axes or record.axes:
        reading = reading_of(samples.axes[axis], samples.rate_hz)
        print_axis(axis, result, reading, held[axis])
    searched_axes = [axis for axis in arguments.axes or record.axes if axis in result.cleaned]
    print_means(record, result, searched_axes)
    if arguments.figures:
        draw(record, result, searched_axes, arguments.figures / f"case_{arguments.recording.stem}")
    if arguments.again:
        simulate_again(record, result)


if __name__ == "__main__":
    main()
