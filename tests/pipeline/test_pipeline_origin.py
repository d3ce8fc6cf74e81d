"""Samples that no part measured are called so in every result, whatever brought them."""

import json

import pytest

from allanscope.__main__ import main
from allanscope.analysis import verdict
from allanscope.pipeline import DeviceSettings, analyse_input
from allanscope.view import summary_lines
from allanscope.view.terminal_screen import status_line


@pytest.mark.parametrize("wire", ["native", "datalog"])
def test_a_simulated_recording_is_called_simulated_in_json_report_and_terminal(
    wire, tmp_path, capsys
):
    recording, result, report = (tmp_path / name for name in ("a.mcap", "a.json", "a.html"))
    assert main(["simulate", str(recording), "--hours", "0.003", "--wire", wire]) == 0
    files = ["--json", str(result), "--report", str(report)]
    assert main(["analyse", str(recording), *files]) == 0
    assert json.loads(result.read_text())["origin"] == "synthetic"
    assert '<p class="banner">Simulated data: a program' in report.read_text()
    assert "Simulated data" in capsys.readouterr().out
    analysis = analyse_input(recording, DeviceSettings(), quiet=True)
    known = verdict(analysis)
    assert known.banner.startswith("Simulated data: a program computed the samples")
    assert any("Simulated data" in line for line in summary_lines(analysis))
    assert status_line(analysis).endswith("simulated data")


@pytest.mark.usefixtures("undrawn")
def test_the_simulated_device_is_called_so_live_in_a_format_that_cannot_say_it(tmp_path, capsys):
    out = tmp_path / "session"
    command = ["live", "sim", "--wire", "datalog", "--for", "4s", "--view", "none"]
    assert main([*command, "--out", str(out)]) == 0
    assert "Simulated data: a program computed the samples" in capsys.readouterr().out
    assert json.loads((out / "result.json").read_text())["origin"] == "synthetic"
    again = analyse_input(out, DeviceSettings(), quiet=True)
    assert again.origin == "synthetic", "the recording keeps it"


def test_what_does_not_say_where_it_comes_from_is_called_nothing(tmp_path):
    table = tmp_path / "a.csv"
    rows = "".join(f"{i / 100},{(i * 37) % 11}\n" for i in range(400))
    table.write_text("t[s],gx[mdps]\n" + rows)
    analysis = analyse_input(table, DeviceSettings(), quiet=True)
    assert analysis.to_dict()["origin"] is None
    assert not verdict(analysis).banner
