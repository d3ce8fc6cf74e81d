"""Reports by command: one session or several, figures as files, and what goes wrong in one line."""

import re
from contextlib import closing

import pytest

from allanscope.cli import parser
from allanscope.errors import UsageError
from allanscope.pipeline import (
    DeviceSettings,
    SimulatedSettings,
    analyse_input,
    simulate_recording,
    write_report,
)
from allanscope.pipeline.outputs import ReportProcess


@pytest.fixture(scope="module")
def units(tmp_path_factory):
    folder = tmp_path_factory.mktemp("units")
    for seed in (1, 2):
        path = folder / f"unit {seed}" / "night.mcap"
        path.parent.mkdir()
        settings = SimulatedSettings(seed=seed)
        simulate_recording(path, 8.0 / 3600.0, DeviceSettings(), settings, quiet=True)
    return folder


def test_two_sessions_are_compared_with_figures_as_files(run, units, tmp_path):
    first, second = units / "unit 1" / "night.mcap", units / "unit 2" / "night.mcap"
    page, figures = tmp_path / "both.html", tmp_path / "figures"
    ran = run("report", first, second, "--out", page, "--figures", figures, "--quiet")
    assert ran.stdout.strip() == str(page)
    assert ran.stderr == ""
    text = page.read_text()
    assert text.count("unit 1/night.mcap") > 6, "the folder that they share is left out"
    assert str(units) not in text
    assert len(re.findall("spread between sessions", text)) == 6
    assert sorted(path.name for path in figures.iterdir()) == sorted(
        f"{axis}-comparison.{form}"
        for axis in ("gx", "gy", "gz", "ax", "ay", "az")
        for form in ("svg", "png")
    )


def test_one_session_twice_is_no_comparison(run, units, tmp_path):
    path = units / "unit 1" / "night.mcap"
    ran = run("report", path, path, "--out", tmp_path / "page.html", code=2)
    assert ran.stderr.strip().count("\n") == 0
    assert "named twice" in ran.stderr
    assert not list(tmp_path.iterdir())


def test_figures_that_cannot_be_written_are_one_clear_line(run, units, tmp_path):
    (tmp_path / "taken").write_text("a file, no folder")
    arguments = ("analyse", units / "unit 1" / "night.mcap", "--figures", tmp_path / "taken")
    ran = run(*arguments, "--quiet", code=2)
    assert ran.stderr.strip().count("\n") == 0
    assert "cannot write figures" in ran.stderr


def test_the_numbers_are_there_though_a_picture_cannot_be_written(run, units, tmp_path):
    (tmp_path / "taken").write_text("a file, no folder")
    arguments = ("--json", tmp_path / "result.json", "--figures", tmp_path / "taken", "--quiet")
    run("analyse", units / "unit 1" / "night.mcap", *arguments, code=2)
    assert (tmp_path / "result.json").read_text().startswith("{")


def test_every_command_has_an_example_in_its_help_that_it_would_accept():
    top = parser()
    (commands,) = [
        action for action in top._actions if hasattr(action, "choices") and action.choices
    ]
    for name, one in commands.choices.items():
        example = re.search(r"Example: allanscope (.*)", one.format_help())
        assert example, name
        words = example[1].split("#")[0].split()
        assert words[0] == name
        assert top.parse_args(words).command is not None


def test_another_process_writes_the_same_report_and_says_what_it_cannot(units, tmp_path):
    analysis = analyse_input(units / "unit 1" / "night.mcap", DeviceSettings())
    write_report(analysis, tmp_path / "here.html")
    with closing(ReportProcess()) as process:
        process.begin(analysis)
        with pytest.raises(UsageError, match="cannot write"):
            process.write(tmp_path / "no folder" / "there.html")
        process.write(tmp_path / "there.html")
    here = (tmp_path / "here.html").read_bytes()
    assert (tmp_path / "there.html").read_bytes() == here
    process.begin(analysis)  # whose process has ended
    process.write(tmp_path / "dead.html")
    assert (tmp_path / "dead.html").read_bytes() == here
