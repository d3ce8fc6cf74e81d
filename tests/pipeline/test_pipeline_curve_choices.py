"""What is chosen of the curves is in the result, the table and the report, and is what it says."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from allanscope import CurveChoices, analyse, deviation
from allanscope.__main__ import main

RATE = 100.0
DATA = np.round(np.random.default_rng(3).normal(0, 0.05, 1500), 5)


@pytest.fixture(scope="module")
def text(tmp_path_factory):
    path = tmp_path_factory.mktemp("choices") / "gx.csv"
    path.write_text("gx[dps]\n" + "".join(f"{x:.5f}\n" for x in DATA), encoding="ascii")
    return path


def run(text, folder, *options):
    """Return exit code, result, table and page of one analysis."""
    names = [folder / name for name in ("r.json", "t.csv", "r.html")]
    written = zip(("--json", "--table", "--report"), map(str, names), strict=True)
    arguments = [word for pair in written for word in pair]
    code = main(["analyse", str(text), "--rate", "100", "--quiet", *arguments, *options])
    if code not in (0, 5):  # also of a comparison that fails
        return code, None, None, None
    with names[1].open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    return code, json.loads(names[0].read_text()), table, names[2].read_text(encoding="utf-8")


def test_taus_of_ones_own_are_those_of_the_samples(text, tmp_path):
    code, result, table, page = run(text, tmp_path, "--taus", "0.05,0.3,1", "--variance")
    assert code == 0
    curves = result["axes"]["gx"]["curves"]
    for kind in ("oadev", "mdev", "hdev", "totdev", "pdev"):
        exact = deviation(DATA, RATE, kind, taus=[0.05, 0.3, 1.0])
        assert curves[kind]["tau"] == pytest.approx(exact.tau)
        assert curves[kind]["deviation"] == pytest.approx(exact.deviation)
        assert curves[kind]["upper"] == pytest.approx(exact.upper)
        assert curves[kind]["noise"] == exact.noise.tolist()
        assert curves[kind]["variance"] == pytest.approx(exact.deviation**2)
    mvar = {float(row["tau_s"]): row for row in table if row["estimator"] == "MAVAR"}
    assert float(mvar[0.3]["value"]) == pytest.approx(curves["mdev"]["variance"][1])
    assert float(mvar[0.3]["upper"]) == pytest.approx(curves["mdev"]["upper"][1] ** 2)
    assert all(name in page for name in ("OAVAR", "(mdps)²", "overlapping Allan variance"))
    assert result["curve_choices"]["taus"] == [0.05, 0.3, 1.0]


def test_estimators_factor_noise_type_bias_and_simple_limits(text, tmp_path):
    code, result, table, page = run(
        *(text, tmp_path, "--kinds", "hdev,totdev,theo1", "--per-octave", "1", "--bias", "all"),
        *("--hadamard", "dt0064", "--noise-type", "rwfm", "--simple-limits"),
    )
    assert code == 0
    curves = result["axes"]["gx"]["curves"]
    assert list(curves) == ["hdev", "totdev", "theo1", "oadev"]
    given = {"noise": "RWFM", "bias_corrected": "all", "hadamard_factor": "dt0064"}
    for kind, curve in curves.items():
        exact = deviation(DATA, RATE, kind, taus=1, **given)
        known = dict(zip(exact.tau.round(6).tolist(), exact.deviation.tolist(), strict=True))
        pairs = zip(np.round(curve["tau"], 6).tolist(), curve["deviation"], strict=True)
        shared = [(value, known[tau]) for tau, value in pairs if tau in known and tau < 0.5]
        assert len(shared) >= 2
        assert [one for one, _ in shared] == pytest.approx([other for _, other in shared])
        assert set(curve["noise"]) == {"RWFM"}
        error = np.array(curve["deviation"]) / np.sqrt(curve["terms"])
        assert curve["simple_upper"] == pytest.approx(np.array(curve["deviation"]) + error)
    assert len({row["estimator"] for row in table}) == 4
    assert "1/2 (DT0064)" in page
    assert "RWFM at every τ" in page
    assert "removed from TOTDEV and THEO1 too" in page


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--taus", "0.1,9"], "stdev at tau 9 s needs 300 samples (3 s) more than the 1500"),
        (["--taus", "0.001,1"], "tau 0.001 s is shorter than half a sample of 0.01 s"),
        (["--taus", "sometimes"], "unknown taus 'sometimes'; choose octave, decade, many, all"),
        (["--taus", "1,x"], "not a list of times in s"),
        (["--kinds", "oadev,avar"], "unknown estimator 'avar'; choose from stdev ostdev adev"),
        (["--noise-type", "pink"], "unknown noise type 'pink'; choose one of WPM FPM"),
        (["--per-octave", "0"], "0 averaging times in each octave; take 1 to 64"),
    ],
)
def test_what_cannot_be_chosen_is_a_usage_error(text, tmp_path, capsys, options, message):
    try:
        code = main(["analyse", str(text), "--rate", "100", "--quiet", *options])
    except SystemExit as stopped:
        code = stopped.code
    assert code == 2
    assert message in capsys.readouterr().err


def test_sets_of_taus_from_python_are_those_of_the_array():
    lost = slice(700, 750)
    given = {"t": np.delete(np.arange(1500) / RATE, lost), "gx": np.delete(DATA, lost)}
    with_gap = DATA.copy()
    with_gap[lost] = np.nan
    for taus in ("octave", "decade", "many"):
        choices = CurveChoices(kinds=("oadev", "theo1"), taus=taus)
        axis = analyse(given, curves=choices).axes["gx"]
        for kind in ("oadev", "theo1"):
            exact = deviation(with_gap, RATE, kind, taus=taus)
            found = axis.curves[kind]
            short = [m for m in exact.m.tolist() if m < 64 and m in found.m.tolist()]
            assert len(short) >= 2
            np.testing.assert_allclose(
                found.deviation[np.isin(found.m, short)],
                exact.deviation[np.isin(exact.m, short)],
                rtol=1e-9,
            )


def test_all_taus_are_refused_where_nobody_waits_for_them():
    choices = CurveChoices(taus="all")
    few = choices.of_samples(DATA[:50], "oadev", 0.95, RATE)
    assert few.m.tolist() == list(range(1, 25))
    with pytest.raises(ValueError, match="all averaging times of 300000 samples take too long"):
        choices.of_samples(np.zeros(300_000), "oadev", 0.95, RATE)


@pytest.mark.parametrize(("kind", "n"), [("htotdev", 200_000), ("theo1", 400_000)])
def test_windows_of_a_long_record_are_refused_where_nobody_waits_for_them(kind, n):
    record = np.zeros(n)
    with pytest.raises(ValueError, match=f"{kind} at .* of {n} samples is a sum of .* squares"):
        CurveChoices(taus="many").of_samples(record, kind, 0.95, RATE)
    few = CurveChoices(taus=(0.12,)).of_samples(DATA[:50], kind, 0.95, RATE)
    assert few.m.size == 1


def test_a_curve_is_compared_with_an_earlier_session_and_with_a_mask(text, tmp_path, capsys):
    code, alone, _, _ = run(text, tmp_path, "--per-octave", "4")
    assert code == 0
    assert alone["axes"]["gx"]["comparison"] is None
    (tmp_path / "result.json").write_text(json.dumps(alone))
    noisier = tmp_path / "noisier.csv"
    noisier.write_text("gx[dps]\n" + "".join(f"{1.5 * x:.5f}\n" for x in DATA), encoding="ascii")
    capsys.readouterr()
    code, result, _, page = run(noisier, tmp_path, "--compare", str(tmp_path))
    assert code == 5, "a script on a test bench sees it"
    said = capsys.readouterr().err
    assert said == f"allanscope: higher than {tmp_path.name}: gx (1 of 1 axes)\n"
    found = result["axes"]["gx"]["comparison"]
    assert not found["passed"]
    assert found["ratio"] == pytest.approx(1.5, rel=1e-3)
    assert found["reference"] == tmp_path.name
    assert "1.50 times higher" in page
    mask = tmp_path / "mask.csv"
    mask.write_text("tau,gyro\n0.01,0.06\n1,0.006\n")
    assert main(["analyse", str(text), "--rate", "100", "--compare", str(mask)]) == 0
    assert "PASS against mask.csv: no axis higher at τ = " in capsys.readouterr().out
    mask.write_text("tau,gyro\n1e4,0.06\n1e5,0.006\n")
    assert main(["analyse", str(text), "--rate", "100", "--compare", str(mask)]) == 5
    assert "averaging times of mask.csv: nothing was compared" in capsys.readouterr().err
    assert main(["analyse", str(text), "--rate", "100", "--compare", "nowhere"]) == 3
    assert "cannot compare with nowhere" in capsys.readouterr().err


def test_power_laws_stand_in_result_and_report(tmp_path):
    """White noise, flicker phase noise and a random run, each on an axis, by intervals of 95 %."""
    recording = tmp_path / "noises.mcap"
    noises = ("N=0.003,P=0.0005,axis=gx", "N=0.003,F=0.003,axis=gy", "N=0.01,D=0.01,axis=gz")
    given = [word for one in noises for word in ("--noise", one)]
    main(
        [
            "simulate",
            str(recording),
            "--hours",
            "0.1",
            "--rate",
            "104",
            "--seed",
            "1",
            "--quiet",
            *given,
        ]
    )
    code, result, _, page = run(recording, tmp_path, "--power-laws", "auto")
    assert code == 0
    assert result["curve_choices"]["power_laws"] == "auto"
    for axis, letter, truth in (("gx", "P", 0.0005), ("gx", "N", 0.003), ("gy", "F", 0.003)):
        one = result["axes"][axis]["power_laws"][letter]
        assert one["detected"]
        assert one["lower"] < truth < one["upper"]
    assert result["axes"]["gz"]["power_laws"]["D"]["detected"]
    assert set(result["axes"]["ax"]["power_laws"]) == set("NBK")
    assert "flicker phase noise" in page
    assert "°/h/h/√h" in page
    assert "Power laws fitted together" in page


def test_power_laws_that_cannot_be_fitted_together_are_refused(text, capsys):
    for letters, message in (("XN", "unknown power laws"), ("PF", "cannot be fitted beside")):
        assert main(["analyse", str(text), "--rate", "100", "--power-laws", letters]) == 2
        assert message in capsys.readouterr().err
