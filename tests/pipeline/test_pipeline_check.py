"""The gate: exit code 5 when a coefficient misses its limit, and nothing that lets all pass."""

import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from allanscope import analyse
from allanscope.__main__ import main
from allanscope.pipeline.check import compare

RATE, SIGMA = 100.0, 0.02
N = SIGMA / np.sqrt(RATE)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return a table of white noise of a known N on gx and gy."""
    path = tmp_path_factory.mktemp("check") / "log.csv"
    noise = SIGMA * np.random.default_rng(4).standard_normal((1500, 2))
    np.savetxt(path, noise, fmt="%.7f", delimiter=",", header="gx[dps],gy[dps]", comments="")
    return path


@pytest.fixture
def check(log, tmp_path, capsys):
    """Hold the log against a specification; return the exit code and what was said."""

    def run(text):
        specification = tmp_path / "spec.toml"
        specification.write_text(text)
        arguments = ["check", str(log), "--against", str(specification), "--rate", f"{RATE:g}"]
        code = main(arguments)
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


def test_what_is_met_is_listed(check):
    code, out, err = check(f"[gx]\nN = {2 * N}\n[gy]\nN = {{ min = {N / 2}, max = {2 * N} }}\n")
    assert (code, err) == (0, "")
    assert [line.split()[:2] for line in out.splitlines()] == [["gx", "N"], ["gy", "N"]]
    for line in out.splitlines():
        assert re.fullmatch(r"g[xy] N  0\.00\d+ dps/sqrt\(Hz\) .* PASS", line)


@pytest.mark.parametrize("limit", [f"{N / 2}", f"{{ max = {N / 2} }}", f"{{ min = {2 * N} }}"])
def test_what_is_missed_is_one_line_and_exit_5(check, limit):
    code, out, err = check(f"[gyro]\nN = {limit}\n[gx]\nN = 1\n")
    assert code == 5
    assert err.count("\n") == 1
    assert err == "allanscope: 2 of 3 limits missed: N of gy, N of gz\n"
    verdicts = {line[:4]: line for line in out.splitlines()}
    assert verdicts["gx N"].endswith("PASS")
    assert "FAIL  0.0" in verdicts["gy N"]


def test_axes_that_explain_each_other_are_judged_as_measured():
    rng = np.random.default_rng(5)
    own = SIGMA * rng.standard_normal(30_000)
    other = own + 0.1 * SIGMA * rng.standard_normal(30_000)
    analysis = analyse({"gx": own, "gy": other}, RATE)
    assert analysis.axes["gx"].coefficients["N"].decoupled.value < N / 5
    verdicts = compare(analysis, {"gx": {"N": {"max": N / 2}}, "gy": {"N": {"max": 2 * N}}})
    assert [(v.axis, v.passed) for v in verdicts] == [("gx", False), ("gy", True)]
    assert verdicts[0].value == pytest.approx(N, rel=0.02)


def test_an_axis_that_is_not_there_misses_its_limit(check):
    code, out, err = check("[az]\nN = 1\n")
    assert code == 5
    assert "the recording does not have this axis" in out
    assert "N of az" in err


def test_the_verdicts_are_written_for_machines(log, tmp_path, capsys):
    """Both reports are there although, and before, the check fails."""
    specification = tmp_path / "spec.toml"
    specification.write_text(
        f"[gx]\nN = {2 * N}\nK = 1e-9\n[gy]\nN = {{ min = 0, max = {N / 2} }}\n"
    )
    junit, as_json = tmp_path / "check.xml", tmp_path / "check.json"
    arguments = ["check", str(log), "--against", str(specification), "--rate", f"{RATE:g}"]
    code = main([*arguments, "--junit", str(junit), "--json", str(as_json)])
    lines = capsys.readouterr().out.splitlines()
    assert code == 5
    suite = ElementTree.parse(junit).getroot().find("testsuite")
    assert (suite.get("tests"), suite.get("failures")) == ("3", "2")
    cases = {(c.get("classname"), c.get("name")): c for c in suite.iter("testcase")}
    assert set(cases) == {("allanscope.gx", "N"), ("allanscope.gx", "K"), ("allanscope.gy", "N")}
    assert cases["allanscope.gx", "N"].find("failure") is None
    assert cases["allanscope.gy", "N"].find("failure").text in lines
    document = json.loads(as_json.read_text())
    assert document["schema"] == "allanscope-check/1"
    assert not document["passed"]
    verdicts = {(v["axis"], v["coefficient"]): v for v in document["verdicts"]}
    assert verdicts["gx", "N"]["verdict"] == "PASS"
    assert verdicts["gx", "N"]["value"] == pytest.approx(N, rel=0.1)
    assert verdicts["gx", "N"]["maximum"] == 2 * N
    walk = verdicts["gx", "K"]
    assert (walk["verdict"], walk["detected"]) == ("FAIL", False)
    assert "not detected; the upper limit" in walk["reason"]
    assert any(line.startswith("gx K  < ") and "FAIL" in line for line in lines)
    code = main([*arguments, "--json", "-"])
    assert json.loads(capsys.readouterr().out) == document
    assert code == 5


def test_what_was_not_detected_is_not_at_least_anything(check):
    code, out, _ = check("[gx]\nK = { min = 1e-12 }\n")
    assert code == 5
    assert "FAIL  not detected" in out
    assert check("[gx]\nK = { min = 0 }\n")[0] == 0


@pytest.mark.parametrize("option", ["--junit", "--json"])
def test_a_place_that_cannot_be_written_to_is_refused_before_the_work(option, tmp_path, capsys):
    code = main(
        ["check", "nothing.mcap", "--against", "x.toml", option, str(tmp_path / "no" / "f")]
    )
    assert code == 2
    assert "cannot write" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["", "[gyro]\n", "[gyro]\nN = true\n", "[gyro]\nn = 1\n", "[g]\n"])
def test_a_specification_that_says_nothing_lets_nothing_pass(check, text):
    code, out, err = check(text)
    assert (code, out) == (3, "")
    assert err.count("\n") == 1
    assert "spec.toml" in err
