"""The gate: exit code 5 when a coefficient misses its limit, and nothing that lets all pass."""

import numpy as np
import pytest

from allanscope.__main__ import main

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
    assert [line.split(" is ")[0] for line in out.splitlines()] == ["gx N", "gy N"]


@pytest.mark.parametrize("limit", [f"{N / 2}", f"{{ max = {N / 2} }}", f"{{ min = {2 * N} }}"])
def test_what_is_missed_is_one_line_and_exit_5(check, limit):
    code, out, err = check(f"[gyro]\nN = {limit}\n[gx]\nN = 1\n")
    assert (code, out) == (5, "")
    assert err.count("\n") == 1
    assert "gy N is" in err
    assert "gx" not in err  # its own limit overrules that of the group


def test_an_axis_that_is_not_there_misses_its_limit(check):
    code, _, err = check("[az]\nN = 1\n")
    assert code == 5
    assert "az N: the recording does not have this axis" in err


@pytest.mark.parametrize("text", ["", "[gyro]\n", "[gyro]\nN = true\n", "[gyro]\nn = 1\n", "[g]\n"])
def test_a_specification_that_says_nothing_lets_nothing_pass(check, text):
    code, out, err = check(text)
    assert (code, out) == (3, "")
    assert err.count("\n") == 1
    assert "spec.toml" in err
