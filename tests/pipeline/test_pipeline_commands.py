"""The command line for those who meet it first: help, lengths of time, what was written where."""

import argparse
import json
import subprocess
import sys

import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.arguments import _duration
from allanscope.errors import ExitCode
from allanscope.pipeline import DeviceSettings, SimulatedSettings, simulate_recording


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("commands") / "night.mcap"
    simulate_recording(path, 8.0 / 3600.0, DeviceSettings(), SimulatedSettings(seed=3), quiet=True)
    return path


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return one axis, of which a report has few pictures."""
    path = tmp_path_factory.mktemp("commands") / "log.csv"
    noise = np.random.default_rng(3).normal(0, 0.04, 400)
    np.savetxt(path, np.column_stack([np.arange(400) / 52, noise]), fmt="%.6f", delimiter=",",
               header="t[s],gx[dps]", comments="")  # fmt: skip
    return path


def test_without_a_command_there_is_help(capsys):
    assert main([]) == 0
    said = capsys.readouterr()
    assert said.out.startswith("usage: allanscope")
    assert "analyse" in said.out
    assert said.err == ""


def test_an_empty_argument_does_not_stand_for_the_present_folder(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["live", ""])
    assert ended.value.code == 2
    assert "an argument is empty" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("90", 90.0),
        ("90s", 90.0),
        ("2.5", 2.5),
        ("10m", 600.0),
        ("1.5h", 5400.0),
        ("1h30m", 5400.0),
        ("1h30m10s", 5410.0),
        ("2d", 172800.0),
        ("1d12h", 129600.0),
    ],
)
def test_a_length_of_time_is_written_as_people_write_it(text, seconds):
    assert _duration(text) == seconds


@pytest.mark.parametrize("text", ["", "h", "1h30", "30m m", "1h 30m", "-5s", "0", "nan", "1e3s"])
def test_what_is_no_length_of_time_is_refused(text):
    with pytest.raises(argparse.ArgumentTypeError, match=r"write e\.g\. 90s"):
        _duration(text)


def test_every_command_that_writes_names_what_it_wrote(recording, log, tmp_path, capsys):
    page, result, figures = tmp_path / "r.html", tmp_path / "r.json", tmp_path / "figures"
    table, imported, yaml = tmp_path / "t.csv", tmp_path / "t.mcap", tmp_path / "imu.yaml"
    saved, made, both = tmp_path / "s.mcap", tmp_path / "m.mcap", tmp_path / "both.html"
    written = {
        ("analyse", log, "--report", page, "--json", result): (page, result),
        ("export", recording, table): (table,),
        ("export", recording, yaml, "--upper-limits", "include"): (yaml,),
        ("import", table, imported): (imported,),
        ("recover", recording, saved): (saved,),
        ("simulate", made, "--hours", "0.002"): (made,),
        ("report", log, "--out", both, "--figures", figures): (both, figures),
    }
    for arguments, files in written.items():
        assert main([*map(str, arguments)]) == 0
        said = capsys.readouterr().out
        for file in files:
            assert file.exists()
            assert str(file) in said, arguments[0]


@pytest.mark.parametrize(("name", "axis"), [("Accelerometer", "ax"), ("night", "gx")])
def test_the_name_of_a_file_tells_its_sensor_after_an_import_too(name, axis, tmp_path, capsys):
    table, imported = tmp_path / f"{name}.csv", tmp_path / "i.mcap"
    noise = np.random.default_rng(8).normal(0, 0.02, (600, 3))
    rows = np.column_stack([np.arange(600) / 100, noise])
    np.savetxt(table, rows, "%.4f", ",", header="t,x,y,z", comments="")
    assert main(["import", str(table), str(imported)]) == 0
    for path in (table, imported):
        capsys.readouterr()
        assert main(["analyse", str(path), "--json", "-", "--quiet"]) == 0
        assert next(iter(json.loads(capsys.readouterr().out)["axes"])) == axis


def test_a_result_on_standard_output_stays_alone(log, tmp_path, capsys):
    page = tmp_path / "r.html"
    assert main(["analyse", str(log), "--json", "-", "--report", str(page)]) == 0
    said = capsys.readouterr()
    assert said.out.startswith("{")
    assert said.out.rstrip().endswith("}")
    assert f"Saved: {page}" in said.err


@pytest.mark.usefixtures("undrawn")
def test_a_replay_names_its_files_and_how_to_see_the_charts_again(recording, tmp_path, capsys):
    folder = tmp_path / "again"
    assert main(["replay", str(recording), "--view", "none", "--out", str(folder)]) == 0
    said = capsys.readouterr().out
    assert f"Saved: {folder / 'report.html'}; beside it result.json, session.rrd" in said
    assert f"allanscope open {folder}" in said
    assert {"session.rrd", "result.json", "report.html"} == {file.name for file in folder.iterdir()}


UNTIL_OPENED = """
import os, sys
def hook(event, given):
    if event == "open" and given[0] == sys.argv[1]:
        print(*sys.modules, flush=True)
        os._exit(0)
sys.addaudithook(hook)
from allanscope.__main__ import main
main(sys.argv[2:])
"""


@pytest.mark.parametrize("words", [["analyse"], ["report", "--out", "page.html"]])
def test_what_fits_and_draws_is_loaded_after_the_input_was_read(words, tmp_path):
    """Half of a second would pass before a large file is looked at, or a bad one refused."""
    csv = tmp_path / "made.csv"
    csv.write_text("t[s],gx[dps]\n0.0,1.0\n")
    command = [sys.executable, "-c", UNTIL_OPENED, str(csv), *words, str(csv)]
    run = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    loaded = set(run.stdout.split())
    assert "allanscope.pipeline.analyse_file" in loaded
    assert not loaded & {"matplotlib", "rich", "allanscope.analysis.summary"}


@pytest.mark.parametrize(
    "words",
    [
        "export {0} {0}",
        "analyse {0} --rate 100 --json {0}",
        "analyse {0} --rate 100 --report {1}",
        "analyse {0} --rate 100 --table {0}",
        "report {0} --out {0}",
    ],
)
def test_no_result_is_written_over_what_is_read(tmp_path, capsys, words):
    path, link = tmp_path / "night.csv", tmp_path / "link.html"
    text = "gx[dps]\n" + "\n".join(f"{0.01 * (i * 37 % 11)}" for i in range(500))
    path.write_text(text)
    link.symlink_to(path)
    assert main(words.format(path, link).split()) == ExitCode.USAGE
    assert "is read, and would be overwritten" in capsys.readouterr().err
    assert path.read_text() == text


def test_a_title_may_be_longer_than_the_name_of_a_file(log, tmp_path):
    """Options were asked whether they name a file that is read; this one cannot."""
    page = tmp_path / "page.html"
    assert main(["analyse", str(log), "--report", str(page), "--title", "x" * 5000]) == 0
    assert "x" * 5000 in page.read_text(encoding="utf-8")
