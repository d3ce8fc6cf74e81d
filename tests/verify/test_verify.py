"""A verification passes here, and fails when anything that it looks at is wrong by a little."""

import json
from fractions import Fraction

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.allan.cascade import Cascade
from allanscope.allan.estimators import REGISTRY
from allanscope.allan.kernels import COLUMNS
from allanscope.recording import recovery
from allanscope.spectrum import ladder
from allanscope.verify import certified, checks, table_lines, verify


def only(monkeypatch, *names):
    """Leave only some checks, and return what they find."""
    monkeypatch.setattr(checks, "CHECKS", {name: checks.CHECKS[name] for name in names})
    return verify()


@pytest.mark.slow
def test_this_machine_computes_what_is_certified(tmp_path, capsys):
    path = tmp_path / "verified.json"
    assert main(["verify", "--json", str(path)]) == 0
    said, filed = capsys.readouterr().out, json.loads(path.read_text())
    assert said.count("PASS") == len(checks.CHECKS) == len(filed["checks"])
    assert filed["schema"] == "allanscope-verify/1"
    assert filed["passed"]
    assert filed["processor_s"] > 0
    assert {"python", "numpy", "scipy"} <= filed["versions"].keys()
    assert all(filed["machine"].values())
    assert all(len(digest) == 64 for digest in filed["sha256"].values())
    # The data are the same everywhere.
    assert filed["sha256"]["integers"].startswith("0bc6b51544df")
    assert filed["sha256"]["record"].startswith("f7bb61023f29")
    of = {check["name"]: check for check in filed["checks"]}
    assert of["sixteen estimators"]["digits"] >= 12
    assert {value["what"].split()[0] for value in of["sixteen estimators"]["values"]} >= set(
        REGISTRY
    )


@pytest.mark.parametrize("kind", ["oadev", "ohdev", "mdev", "pdev", "adev", "hdev", "totdev"])
def test_a_kernel_that_is_wrong_in_the_last_bit_is_found(kind, monkeypatch):
    close, column = Cascade.close, COLUMNS.index(kind)

    def wrong(self):
        close(self)
        self.sums[0, 12, column] = np.nextafter(self.sums[0, 12, column], np.inf)

    monkeypatch.setattr(Cascade, "close", wrong)
    (check,) = only(monkeypatch, "running sums")
    assert not check.passed
    assert [value.what for value in check.values if value.digits < 17] == [
        f"sum of squares of {kind} at m = 90"
    ]


@pytest.mark.parametrize("kind", ["theo1", "mtotdev", "pdev"])
def test_an_estimator_that_is_wrong_in_the_eleventh_digit_is_found(kind, monkeypatch):
    estimator = REGISTRY[kind]
    exact = type(estimator).exact

    def wrong(self, phase, m):
        variance, terms = exact(self, phase, m)
        return variance * (1 + 1e-11), terms

    monkeypatch.setattr(type(estimator), "exact", wrong)
    monkeypatch.setattr(
        type(estimator),
        "curve",
        lambda self, phase, factors: [wrong(self, phase, m) for m in factors],
    )
    (check,) = only(monkeypatch, "sixteen estimators")
    assert not check.passed
    assert kind in check.worst.what or REGISTRY[check.worst.what.split()[0]].derived_from


def test_a_decoder_that_changes_one_bit_is_found(monkeypatch):
    received = checks._received

    def wrong(events):
        info, rows = received(events)
        rows[7, 2] += 1
        return info, rows

    monkeypatch.setattr(checks, "_received", wrong)
    (check,) = only(monkeypatch, "wire formats")
    assert not check.passed
    assert "values that differ" in check.worst.what


def test_a_recovery_that_loses_a_read_is_found(monkeypatch):
    messages = recovery._messages
    monkeypatch.setattr(recovery, "_messages", lambda *a: list(messages(*a))[1:])
    (check,) = only(monkeypatch, "damaged recording")
    assert not check.passed


def test_what_fails_is_named_with_exit_code_5_and_filed(monkeypatch, tmp_path, capsys):
    def broken():
        yield checks.Value("one", 1.0, 1.0, 17.0)
        raise RuntimeError("no such \x1b[31mthing")

    sound = ("by hand", 12.0, lambda: [checks.Value("two", 2.0, 2.0 + 1e-13, 13.3)])
    monkeypatch.setattr(checks, "CHECKS", {"sound": sound, "broken": ("by hand", 17.0, broken)})
    path = tmp_path / "verified.json"
    assert main(["verify", "--quiet", "--json", str(path)]) == 5
    said = capsys.readouterr()
    assert "1 of 2 checks failed: broken" in said.err
    assert "stopped by RuntimeError" in said.out
    assert "\x1b" not in said.out
    filed = json.loads(path.read_text())
    assert not filed["passed"]
    assert [check["passed"] for check in filed["checks"]] == [True, False]
    assert main(["verify", "--quiet", "--json", "-"]) == 5
    assert not json.loads(capsys.readouterr().out)["passed"]


def test_the_table_says_how_far_each_check_agrees():
    value = checks.Value("a", 1.0, 1.0, 13.25)
    lines = table_lines([checks.Check("name", "source", 12.0, (value,))])
    assert lines[1].split("  ")[0] == "name"
    assert "13.2 digits" in lines[1]
    assert "PASS" in lines[1]
    assert len(lines) == 2


def test_the_sums_are_those_of_the_definitions():
    rates = certified.integer_record(300)
    phase = [Fraction(value) for value in (0, *np.cumsum(rates).tolist())]
    factors = {"oadev": 2, "adev": 2, "ohdev": 6, "mdev": 2}
    for m in (1, 3, 20, 80):
        sums = certified.squares_of_sums(rates, m, 1)
        for kind, factor in factors.items():
            variance, terms = certified.DEFINITIONS[kind](phase, m)
            assert sums[kind] == variance * factor * terms * m ** (4 if kind == "mdev" else 2)


def test_a_transform_that_is_wrong_in_the_fifth_digit_is_found(monkeypatch):
    """One of its waves is too large by two ten-thousandths."""
    (check,) = only(monkeypatch, "spectrum")
    assert check.passed
    waves = ladder._WAVES.copy()
    waves[5] *= 1.0 + 2e-4
    monkeypatch.setattr(ladder, "_WAVES", waves)
    (check,) = only(monkeypatch, "spectrum")
    assert not check.passed
