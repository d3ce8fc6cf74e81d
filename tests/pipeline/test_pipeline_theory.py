"""Densities become deviations and back on the command line, and the charts of the method drawn."""

import re

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.allan import ROWS, CurveChoices, variance_name
from allanscope.allan.estimators import REGISTRY
from allanscope.allan.kernels import COLUMNS
from allanscope.pipeline import DeviceSettings
from allanscope.pipeline.theory import chain_steps
from allanscope.quantities import count
from allanscope.report import processing_chain


def table(path):
    return np.loadtxt(path, delimiter=",", skiprows=1).T


def test_white_noise_there_and_back(tmp_path):
    density, curve, back = (tmp_path / name for name in ("s.csv", "a.csv", "b.csv"))
    density.write_text("f,S\n0.01,2\n50,2\n", encoding="ascii")
    arguments = ["convert", str(density), str(curve), "--from", "S_y", "--to", "adev"]
    assert main([*arguments, "--rate", "100", "--quiet"]) == 0
    tau, deviation = table(curve)
    assert deviation == pytest.approx(1 / np.sqrt(tau), rel=2e-3)
    assert main(["convert", str(curve), str(back), "--from", "adev", "--to", "S_y", "--quiet"]) == 0
    assert table(back)[1] == pytest.approx(2.0, rel=2e-3)


@pytest.mark.parametrize(
    ("kind", "factor"),
    [
        ("mdev", 0.5),
        ("hdev", 1.0),
        ("pdev", 1.2),
        ("totdev", 1.0),
        ("TDEV", None),
        ("theo1", None),
    ],
)
def test_every_deviation_of_a_density_and_back(tmp_path, kind, factor):
    """White noise of density 2: N^2 / tau times 1/2 for MVAR (at large m), 6/5 for PVAR."""
    density, curve, back = (tmp_path / name for name in ("s.csv", "a.csv", "b.csv"))
    density.write_text("f,S\n0.01,2\n50,2\n", encoding="ascii")
    words = ["convert", str(density), str(curve), "--from", "S_y", "--to", kind]
    assert main([*words, "--rate", "100", "--quiet"]) == 0
    tau, deviation = table(curve)
    if factor is not None:
        assert deviation[-4:] ** 2 * tau[-4:] == pytest.approx(factor, rel=5e-3)
    words = ["convert", str(curve), str(back), "--from", kind, "--to", "S_y"]
    assert main([*words, "--rate", "100", "--quiet"]) == 0
    assert table(back)[1] == pytest.approx(2.0, rel=5e-3)


def test_a_deviation_becomes_another_one(tmp_path):
    """MDEV from ADEV of white noise: half the variance; both at the times of the table."""
    given, out = tmp_path / "a.csv", tmp_path / "m.csv"
    tau = np.array([0.01, 0.1, 1.0, 10.0])
    rows = [f"{t},{1 / np.sqrt(t)}" for t in tau]
    given.write_text("\n".join(["tau,adev", *rows]), encoding="ascii")
    call = ["convert", str(given), str(out), "--from", "adev", "--to", "mdev", "--quiet"]
    assert main(call) == 0
    assert table(out)[0] == pytest.approx(tau)
    assert table(out)[1] ** 2 * tau == pytest.approx([1.0, 0.505, 0.50005, 0.5], rel=5e-3)


@pytest.mark.parametrize(
    ("rows", "words", "message"),
    [
        ("1,1\n2,1\n", ("S_y", "stdev"), "classical variance of flicker noise"),
        ("1,1\n2,0.7\n", ("stdev", "S_y"), "classical variance of flicker noise"),
        ("1,1\n2,0.1\n", ("S_y", "adev"), "infinite for a density"),
        (
            "1,1\n2,1\n",
            ("S_y", "xdev"),
            "unknown quantity 'xdev'; choose S_y, S_phi, L or a deviation",
        ),
    ],
)
def test_what_has_no_conversion_says_why(tmp_path, rows, words, message, capsys):
    path = tmp_path / "x.csv"
    path.write_text(rows, encoding="ascii")
    given, wanted = words
    call = ["convert", str(path), str(tmp_path / "o"), "--from", given, "--to", wanted]
    assert main(call) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_phase_noise_of_a_carrier(tmp_path):
    """L = -140 dBc/Hz is S_phi = 2e-14 rad^2/Hz."""
    given, out = tmp_path / "l.csv", tmp_path / "s.csv"
    given.write_text("1,-120\n10,-140\n", encoding="ascii")
    for wanted, expected in (("S_phi", [2e-12, 2e-14]), ("S_y", [2e-26, 2e-26])):
        call = ["convert", str(given), str(out), "--from", "L", "--to", wanted]
        assert main([*call, "--carrier", "1e7", "--quiet"]) == 0
        assert table(out)[1] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("text", "code"), [("nothing", 3), ("1,2\n", 3), ("1,2\n2,-1\n", 2)])
def test_tables_that_make_no_sense_are_refused(tmp_path, text, code, capsys):
    path = tmp_path / "x.csv"
    path.write_text(text, encoding="ascii")
    call = ["convert", str(path), str(tmp_path / "o"), "--from", "S_y", "--to", "adev"]
    assert main(call) == code
    assert capsys.readouterr().err.startswith("allanscope: ")


@pytest.mark.parametrize("name", ["transfer", "slopes", "chain"])
def test_charts_of_the_method_are_drawn(tmp_path, name):
    assert main(["chart", name, str(tmp_path / "c.svg"), "--rate", "208", "--quiet"]) == 0
    svg = (tmp_path / "c.svg").read_text(encoding="utf-8")
    assert "<svg" in svg
    assert (tmp_path / "c.png").stat().st_size > 5000


def test_the_chart_of_slopes_says_what_saturates(tmp_path):
    assert main(["chart", "slopes", str(tmp_path / "c.svg"), "--quiet"]) == 0
    svg = (tmp_path / "c.svg").read_text(encoding="utf-8")
    assert svg.count("FWFM and RRFM: slope saturates at 2,") == 2  # AVAR and MAVAR
    assert svg.count(">RRFM, slope 3<") == 1  # HVAR


def test_the_chain_says_what_the_program_works_with():
    steps = chain_steps(DeviceSettings(part="LSM6DSM", rate_hz=208.0, gyro_fs=250.0))
    text = " ".join(f"{step.name} {step.what} {step.numbers}" for step in steps)
    facts = (
        *("66.6 Hz", "208 samples/s", "8.75 mdps at 250 dps", f"{count(ROWS)} rows", "32 or more"),
        *("from 1/128 of the run", "fills short gaps", "τ beyond the stretches between gaps"),
    )
    for fact in facts:
        assert fact in text, fact


def test_the_archive_of_the_chain_has_what_no_running_sum_gives():
    (archive,) = [step for step in chain_steps(DeviceSettings()) if step.name == "archive"]
    summed = {variance_name(kind) for kind in COLUMNS}
    there = set(re.findall(r"[A-Z]+1?", archive.numbers.partition(";")[0]))
    # Of the others TVAR is a multiple of MVAR, and TheoH two curves in one.
    named = {variance_name(kind) for kind in REGISTRY}
    assert named - summed - there == {"TVAR", "THEOH"}
    assert there <= named
    assert not summed & there


def test_the_chain_follows_what_was_chosen_of_the_curves():
    chosen = CurveChoices(taus="decade", hadamard="dt0064")
    text = str(processing_chain(None, 100.0, "1 mdps", "all", chosen))
    assert "every start'" in text
    assert "every sample'" in text
    assert "1/128" not in text
    assert "stretches between gaps" not in text
    assert "½ (DT0064) of the mean square" in text
    assert "8 sin⁶ x / x²" in text


def test_the_chain_has_the_variances_of_the_design_tip_where_it_takes_them():
    """DT0064, figure 1: M(m), then D1(m), then M(m) or D1(m) again."""
    steps = chain_steps(DeviceSettings())
    taken = {name: step for step in steps for name in step.numbers.replace(";", "").split()}
    path = ["OSTDVAR", "OAVAR,", "OHVAR"]
    assert [taken[name].name for name in path] == ["M(m)", "D1(m)", "D1(m)"]
    depths = [taken[name].depth for name in path]
    assert depths == [depths[0], depths[0] + 1, depths[0] + 2]
    assert taken["MAVAR"].name == "M(m)"
    assert taken["MAVAR"].depth == taken["OHVAR"].depth


def test_a_table_that_begins_at_zero_is_no_density(tmp_path, capsys):
    path = tmp_path / "own.csv"
    path.write_text("t,gz\n0.0,0.1\n0.01,0.2\n")
    call = ["convert", str(path), str(tmp_path / "o"), "--from", "S_y", "--to", "adev"]
    assert main(call) == 3
    assert "0 in the first column" in capsys.readouterr().err
