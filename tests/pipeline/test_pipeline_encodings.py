"""Output that is piped or goes to a file, where the encoding has no τ, √ or µ: no run fails."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

ENCODINGS = {
    "cp1252": {"PYTHONIOENCODING": "cp1252"},
    "ascii": {"PYTHONIOENCODING": "ascii"},
    "C": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
}
"""A code page as of Windows, the least of all, and a locale that has no names of files either."""


@pytest.fixture(params=list(ENCODINGS))
def encoding(request):
    return ENCODINGS[request.param]


@pytest.fixture
def run(encoding, tmp_path):
    """Run a command with its output in a file; return what it wrote, in bytes."""
    locale = ("LC_ALL", "LC_CTYPE", "LANG", "PYTHONUTF8", "PYTHONIOENCODING")
    environment = {name: value for name, value in os.environ.items() if name not in locale}

    def run(*arguments, code=0):
        with (tmp_path / "o.txt").open("w+b") as out:
            ran = subprocess.run(
                [sys.executable, "-m", "allanscope", *map(str, arguments)],
                stdout=out,
                stderr=subprocess.PIPE,
                env=environment | encoding,
                timeout=110,
                check=False,
            )
            out.seek(0)
            said = out.read()
        assert ran.returncode == code, ran.stderr
        assert b"Encode" not in ran.stderr
        return said, ran.stderr

    return run


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "prüfstand µ"
    folder.mkdir()
    return folder


@pytest.fixture
def table(folder):
    """Return one axis of each sensor: a report of six has three times the pictures."""
    path = folder / "night.csv"
    noise = np.random.default_rng(3).normal(0, [0.04, 0.001], (500, 2))
    np.savetxt(path, np.column_stack([np.arange(500) / 52, noise]), fmt="%.6f", delimiter=",",
               header="t[s],gx[dps],ax[g]", comments="")  # fmt: skip
    return path


@pytest.mark.parametrize("encoding", [ENCODINGS["cp1252"], ENCODINGS["C"]], ids=["cp1252", "C"])
def test_every_command_runs_where_its_words_cannot_be_encoded(run, folder, table):
    recording = folder / "night.mcap"
    run("simulate", folder / "made.mcap", "--hours", "0.001", "--rate", "52")
    run("import", table, recording)
    run("export", recording, folder / "night.parquet")
    run("export", recording, folder / "imu.yaml", "--upper-limits", "include")
    run("recover", recording, folder / "saved.mcap")
    limits = folder / "limits.toml"
    limits.write_text("# höchstens\n[gx]\nN = 1.0\n", encoding="utf-8")
    run("check", recording, "--against", limits)
    run("replay", recording, "--view", "none", "--out", folder / "replay")
    assert "τ" in (folder / "replay" / "report.html").read_text("utf-8")
    run("report", recording, folder / "replay" / ".." / table.name, "--out", folder / "both.html")
    run("ports")
    run("device", "--for", "0.2s", "--json", "--link", folder / "port")
    _, said = run("analyse", folder / "nicht da ü.csv", code=3)
    assert said.count(b"\n") == 1


def test_what_cannot_be_encoded_is_spelled_out(run, folder, table):
    said, _ = run("analyse", table, "--report", folder / "r.html", "--json", folder / "r.json")
    assert b"sqrt Hz" in said
    assert "τ" in (folder / "r.html").read_text("utf-8"), "files are in UTF-8 all the same"
    assert json.loads((folder / "r.json").read_text("utf-8"))["schema"] == "allanscope/1"


@pytest.mark.parametrize("encoding", [ENCODINGS["C"]], ids=["C"])
def test_a_live_run_and_a_lot_end_in_order(run, folder):
    quick = ("--view", "none", "--for", "1.5s", "--rate", "104")
    said, _ = run("live", "sim", *quick, "--out", folder / "live")
    assert b"sqrt Hz" in said
    run("fleet", folder / "live", "--out", folder / "lot", "--workers", "1")
    assert "<html" in (folder / "lot" / "lot.html").read_text("utf-8")
