"""Every file of the measured data beside the project, through `analyse`.

What holds samples gives curves, what does not gives one line and exit 3, and what has no times
asks for the rate.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.pipeline.table_files import table_of_file

RECORDINGS = Path(__file__).parents[3] / "shared" / "recordings"
pytestmark = pytest.mark.skipif(
    not RECORDINGS.is_dir(), reason=f"the measured data are not at {RECORDINGS}"
)

CONSOLES = "lsm6ds3trc_hil_serial"
LOGS = "st_mlc_bsd3_stationary"
GYRO = ("gx", "gy", "gz")
ACCEL = ("ax", "ay", "az")

WITHOUT_TIMES = {
    f"{CONSOLES}/20260622-earlyfail.txt.gz": (0.35, 31, GYRO + ACCEL),
    f"{CONSOLES}/20260622-earlyfail2.txt.gz": (0.35, 35, GYRO + ACCEL),
    f"{CONSOLES}/20260624-soak-10m.txt.gz": (0.12, 69, GYRO + ACCEL),
    f"{CONSOLES}/20260624-soak-30m.txt.gz": (0.077, 131, GYRO + ACCEL),
    f"{LOGS}/asm330lhhx_stationary1.csv.gz": (104.0, 2300, GYRO + ACCEL),
    f"{LOGS}/ism6hg256x_nailgun_stationary.csv.gz": (960.0, 28398, ACCEL),
    f"{LOGS}/lsm6dsv320x_still2.txt.gz": (120.0, 766, GYRO),
    f"{LOGS}/lsm6dsv320x_still3.txt.gz": (120.0, 780, GYRO),
}
"""Files whose rate only the user knows: it, the samples, the axes."""

WITH_TIMES = {
    f"{LOGS}/example3_stationary.csv.gz": (25.2, 506, ACCEL),
    f"{LOGS}/lsm6dsox_still1.csv.gz": (52.1, 874, GYRO + ACCEL),
    f"{LOGS}/lsm6dsox_still3.csv.gz": (52.1, 831, GYRO + ACCEL),
}

LONG = {f"{LOGS}/asm330lhhx_vehicle_stationary.txt.gz": (52.0, 4115, GYRO + ACCEL)}
"""A running engine: the search for effects takes half a minute, so only the refusal is tested."""


def analysed(name, out, *options):
    """Return the exit code and the result."""
    code = main(["analyse", str(RECORDINGS / name), "--quiet", "--json", str(out), *options])
    return code, json.loads(out.read_text()) if out.exists() else None


def test_no_file_is_forgotten():
    there = {
        str(path.relative_to(RECORDINGS)) for path in RECORDINGS.glob("*/*") if path.suffix == ".gz"
    }
    assert there == set(WITHOUT_TIMES) | set(WITH_TIMES) | set(LONG)


@pytest.mark.parametrize("name", [*WITHOUT_TIMES, *WITH_TIMES])
def test_what_holds_samples_gives_curves(name, tmp_path):
    rate, samples, axes = (WITHOUT_TIMES | WITH_TIMES)[name]
    options = ("--rate", str(rate)) if name in WITHOUT_TIMES else ()
    code, result = analysed(name, tmp_path / "result.json", *options)
    assert code == 0
    assert result["samples"] == samples
    assert tuple(result["axes"]) == axes
    assert result["rate"]["nominal_hz"] == pytest.approx(rate, rel=2e-3)
    if name in WITH_TIMES:
        assert result["rate"]["measured_hz"] == pytest.approx(rate, rel=2e-3)
    for axis in result["axes"].values():
        curve = axis["curves"]["oadev"]
        assert len(curve["tau"]) > 8
        assert curve["tau"][0] == pytest.approx(1.0 / rate, rel=2e-3)


@pytest.mark.parametrize("name", [*WITHOUT_TIMES, *LONG])
def test_samples_without_times_ask_for_the_rate(name, tmp_path, capsys):
    code, result = analysed(name, tmp_path / "result.json")
    said = capsys.readouterr().err
    assert (code, result) == (2, None)
    assert said.count("\n") == 1
    assert "--rate HZ" in said


@pytest.mark.parametrize("path", sorted(RECORDINGS.glob("*/*.npz")), ids=lambda p: p.name)
def test_arrays_of_numpy_are_read_by_their_names(path, tmp_path, capsys):
    code, _ = analysed(path, tmp_path / "result.json")
    assert code == 2, "their time is in a unit that is not known, or there is none"
    assert capsys.readouterr().err.count("\n") == 1
    columns = table_of_file(path).columns
    if "gx_counts" in np.load(path):
        assert dict(columns.units) == {"gx": "lsb"}
        return
    assert set(columns.units.values()) == {"rad/s", "mps2"}
    assert "left out, as their names are not known: ts_19p2MHz" in columns.assumed
    gravity = np.linalg.norm([np.mean(columns.axes[a]) for a in ("ax", "ay", "az")])
    assert gravity == pytest.approx(9.8, abs=0.1)


@pytest.mark.parametrize(
    "path",
    sorted(p for p in RECORDINGS.glob("*/*") if p.suffix not in (".gz", ".npz")),
    ids=lambda p: p.name,
)
def test_what_holds_no_samples_that_can_be_read_is_one_line(path, tmp_path, capsys):
    code, result = analysed(path, tmp_path / "result.json")
    said = capsys.readouterr().err
    assert (code, result) == (3, None)
    assert said.count("\n") == 1
    assert len(said) < 400
    assert list(tmp_path.iterdir()) == []
