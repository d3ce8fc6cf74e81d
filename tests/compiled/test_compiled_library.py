"""The library: found or told how to build it, the same bits at every level, sound at every edge."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import allanscope
from allanscope import compiled
from allanscope.allan import archive, kernels
from allanscope.allan.archive import Archive
from allanscope.allan.cascade import Cascade
from allanscope.allan.estimators import reflected, theo1
from allanscope.compiled import LibraryMissing, Pointer, build, kernel
from allanscope.explain import burst_rows, regression
from allanscope.explain.series import series_of
from allanscope.explain.view import View
from allanscope.noise import amplitudes
from allanscope.samples import StreamInfo
from allanscope.spectrum import ladder
from allanscope.watch import Watch, lines, scan, summary
from support.thinned import thinned

PACKAGE = Path(allanscope.__file__).parent
DRIVER = Path(__file__).with_name("every_loop.py")


def copied(tmp_path: Path) -> Path:
    """Return a copy of the package without its library."""
    without = shutil.ignore_patterns("__pycache__", "library.*o", "library.*l*")
    return Path(shutil.copytree(PACKAGE, tmp_path / "site" / "allanscope", ignore=without))


def run(package: Path, *command: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run Python with a copy of the package."""
    path = {"PYTHONPATH": str(package.parent), "PATH": "/usr/bin:/bin", **environment}
    return subprocess.run(
        [sys.executable, *command], env=path, capture_output=True, text=True, check=False
    )


def test_a_library_that_is_missing_or_of_other_sources_is_one_line_with_the_command(
    tmp_path: Path,
) -> None:
    package = copied(tmp_path)
    command = ("-m", "allanscope", "simulate", str(tmp_path / "a.mcap"), "--hours", "0.0003")
    missing = run(package, *command)
    remedy = f"run: python {package / 'compiled' / 'build.py'}"
    assert missing.returncode == 2
    assert missing.stderr.splitlines()[0].endswith(remedy)
    assert len(missing.stderr.splitlines()) == 1
    doctor = run(package, "-m", "allanscope", "doctor", str(tmp_path))
    assert f"-> python {package / 'compiled' / 'build.py'}" in doctor.stdout
    name = build.library_name()
    shutil.copy(PACKAGE / "compiled" / name, package / "compiled" / name)
    assert run(package, *command).returncode == 0
    with (package / "compiled" / "wire.c").open("a") as source:
        source.write("/* changed */\n")
    other = run(package, *command)
    assert "was compiled from other sources" in other.stderr
    assert other.stderr.splitlines()[0].endswith(remedy)


def test_a_call_in_python_without_a_library_is_an_import_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(compiled, "_HERE", tmp_path)
    compiled._library.cache_clear()
    with pytest.raises(LibraryMissing, match="pip install") as caught:
        kernel("decimate")
    assert isinstance(caught.value, ImportError)
    compiled._library.cache_clear()


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((3, 4)),
        np.zeros(4, np.float32),
        np.zeros(8)[::2],
        np.zeros(4, ">f8"),
        np.frombuffer(bytes(32), np.float64),
    ],
)
def test_an_array_that_a_loop_cannot_take_is_refused(array: NDArray[Any]) -> None:
    with pytest.raises(TypeError, match="writeable, contiguous float64 of 1 dim"):
        Pointer(np.float64, 1, written=True).from_param(array)


def test_a_ladder_whose_arrays_do_not_fit_together_is_refused() -> None:
    cascade = Cascade(axes=2, per_octave=1)
    cascade.offsets = np.zeros((2, 2))
    with pytest.raises(ValueError, match="are inconsistent"):
        cascade.extend(np.zeros((5, 2)))
    with pytest.raises(ValueError, match="are inconsistent"):
        Cascade(axes=2, per_octave=1).extend(np.zeros((5, 3)))
    with pytest.raises(ValueError, match="are inconsistent"):
        Cascade(axes=2, per_octave=1).extend(np.zeros((5, 2)), anchor=np.zeros(1))


def results() -> list[NDArray[Any]]:
    """Return what loops give whose sums could depend on the processor."""
    rng = np.random.default_rng(4)
    cascade = Cascade(axes=2, per_octave=4)
    cascade.extend(rng.normal(size=(9001, 2)))
    # Whole numbers: in 16 bits, in 16 but for some terms of MDEV, in 32, and beyond at long lags.
    counts = np.rint(rng.normal(0.0, [3.0, 25.0, 80.0, 300.0, 5000.0], (9001, 5))).astype(np.int16)
    whole = Cascade(axes=5, per_octave=4)
    whole.extend(counts, np.array([1.0, 0.0, 7.0, -200.0, 0.0]))
    quiet = Cascade(axes=2, per_octave=4)  # whole numbers that stay so for a stretch
    quiet.extend(counts[:, :2], np.array([1.0, 0.0]))
    rows = Archive(axes=5, rows=512)
    rows.extend(counts)
    bank = ladder.Ladder(2)
    bank.push(rng.normal(size=(2, 9001)).astype(np.float32))
    watch = Watch(StreamInfo(axes=("gx", "az"), scale=(1.0, 1.0), nominal_hz=104.0))
    watch.rows(np.rint(rng.normal(0.0, 20.0, (300 * 104, 2))).astype(np.int16))
    values = rng.normal(size=901).cumsum()
    columns = np.geomspace(1.0, 1e4, 99) ** np.array([[-2.0], [-1.0], [0.0]])
    power = columns.sum(axis=0) * rng.gamma(5.0, 0.2, 99)
    theta, loglik, expected = amplitudes.maximise(columns, power, np.full(99, 5.0), np.zeros(99))
    view = View.of(series_of(thinned(values[:, np.newaxis])), "gx", None)
    rings = burst_rows._Bank(burst_rows._Rows.of(rng.normal(size=9001)), 32)
    fit = regression.joint_fit(view, regression.step_ordinates(view.grid, 450, view.grid.low))
    return [
        *cascade.settled().arrays().values(),
        *whole.settled().arrays().values(),
        *quiet.settled().arrays().values(),
        rows.sums,
        ladder.narrow_columns(counts, np.zeros(5)),
        *(np.asarray(array) for array in bank.arrays().values()),
        *(np.array(reflected.reflected_mean_square(values, m, 1)) for m in (7, 100)),
        np.array(theo1.theo1_variance(values, 202)),
        *(theta, np.array(loglik), expected),
        *(rings.power(np.arange(99)), rings.largest()),
        *(fit.amplitude, fit.covariance, fit.power, fit.powers),
        *(watch._summarise.power, watch._summarise._noise),
        *(watch._lines._sums, watch._scan._square, watch._scan._fourth),
    ]


def test_every_level_of_the_processor_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    library, level = compiled._library()
    lower = [one for one in build.LEVELS.get(build._architecture(), ()) if one < level]
    if not lower:
        pytest.skip("this processor runs the lowest level alone")
    highest = results()
    used = [
        (kernels._advance, "int16", "cascade_advance_int16"),
        (kernels._advance, "float64", "cascade_advance_float64"),
        (kernels, "_settle", "cascade_settle"),
        (archive._summarise, "int16", "archive_summarise_int16"),
        (ladder, "_decimate", "decimate"),
        (ladder, "_periodograms", "periodograms"),
        (ladder, "_narrow_columns_of_int16", "narrow_columns_of_int16"),
        (reflected, "_squares", "reflected_squares"),
        (theo1, "_squares", "theo1_squares"),
        (amplitudes, "_maximise", "maximise"),
        (regression, "_fit_loop", "fit_signal"),
        (burst_rows, "_powers", "powers_of_pieces"),
        (burst_rows, "_largest", "largest_powers"),
        (summary, "_rows_int16", "watch_rows_int16"),
        (summary, "_levels", "watch_levels"),
        (summary, "_spectrum", "watch_spectrum"),
        (summary, "_noise", "watch_noise"),
        (lines, "_lines", "watch_lines"),
        (scan, "_scan", "scan_block"),
    ]
    for one in lower:
        for module, name, source in used:
            by_name = module if isinstance(module, dict) else vars(module)
            highest_loop = by_name[name]
            lower_loop = library[f"{source}_v{one}"]  # an object of its own
            lower_loop.argtypes, lower_loop.restype = highest_loop.argtypes, highest_loop.restype
            monkeypatch.setitem(by_name, name, lower_loop)
        for found, expected in zip(results(), highest, strict=True):
            assert found.tobytes() == expected.tobytes()


def test_a_loop_reads_and_writes_nothing_that_is_not_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All loops over seeded inputs, from empty ones to the largest, under the sanitizers of gcc."""
    if (gcc := shutil.which("gcc")) is None:
        pytest.skip("no gcc on this machine, whose sanitizers look for wrong memory accesses")
    asan = subprocess.run(
        [gcc, "-print-file-name=libasan.so"], capture_output=True, text=True, check=True
    ).stdout.strip()
    package = copied(tmp_path)
    monkeypatch.setattr(
        build, "FLAGS", ("-std=c99", "-O1", "-g", "-fPIC", "-Wall", "-Wextra", "-Werror")
    )
    architecture, (_, level) = build._architecture(), compiled._library()
    levels = build.LEVELS.get(architecture, {})
    if others := {one: name for one, name in levels.items() if one != level}:
        # This processor runs one level: the compiler's warnings are all that is had of the others.
        monkeypatch.setenv("CC", gcc)
        monkeypatch.setitem(build.LEVELS, architecture, others)
        build.build(tmp_path / "others")
        monkeypatch.setitem(build.LEVELS, architecture, {level: levels[level]})
    undefined = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    monkeypatch.setenv("CC", f"{gcc} {' '.join(undefined)}")
    build.build(package / "compiled")
    ran = run(package, str(DRIVER), LD_PRELOAD=asan, ASAN_OPTIONS="detect_leaks=0")
    assert ran.returncode == 0, ran.stderr[-4000:]
    assert ran.stdout.split() == ["done"]
