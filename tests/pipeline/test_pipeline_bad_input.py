"""Bad input as the user meets it: one clear line, the right exit code, nothing left behind."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
import warnings

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import serial
from serial.tools import list_ports

from allanscope import analyse
from allanscope.__main__ import main
from allanscope.analysis import verdict
from allanscope.pipeline import DeviceSettings, analyse_input

HEADER = "t[s],gx[dps],gy[dps],gz[dps]\n"
ROWS = "".join(f"{i / 104:.6f},0.1,0.2,0.{i % 7}\n" for i in range(600))


@pytest.fixture
def complaint(tmp_path, monkeypatch, capsys):
    """Run a command in an empty folder; return the code, its one line, and check what is left."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        before = sorted(tmp_path.rglob("*"))
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as end:  # the parser's
            code = end.code
        said = capsys.readouterr()
        assert said.err.count("\n") == 1, said.err
        assert said.err.startswith("allanscope: ")
        assert "Traceback" not in said.err
        assert sorted(tmp_path.rglob("*")) == before, "something was left behind"
        return code, said.err

    return run


@pytest.fixture
def port():
    """Return a pty that is some other program's."""
    ours, theirs = pty.openpty()
    yield os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


LIVE = ("--view", "none", "--for", "2s", "--out", "session")


def test_an_unknown_option_names_the_command_whose_help_has_the_others(complaint):
    for call in (("analyse", "log.csv", "--frob"), ("live", "--frob", "sim")):
        code, line = complaint(*call)
        assert code == 2
        assert line.endswith(f"unrecognized arguments: --frob; see allanscope {call[0]} --help\n")


def test_a_mistyped_word_is_answered_with_the_one_that_was_meant(complaint):
    for call, meant in (
        (("analyze", "log.csv"), "unknown command 'analyze'; did you mean analyse? See"),
        (("analyse", "log.csv", "--partt", "x"), "--partt x; did you mean --part? See"),
        (("live", "--view", "windw"), "unknown --view 'windw'; did you mean window? See"),
        (("completion", "tcsh"), "unknown shell 'tcsh'; choose one of bash, zsh, fish; see"),
        (("frobnicate",), "unknown command 'frobnicate'; choose one of live, replay,"),
    ):
        code, line = complaint(*call)
        assert code == 2
        assert meant in line


def test_a_port_that_is_not_there(complaint):
    code, line = complaint("live", "/dev/ttyNothing7", *LIVE)
    assert code == 4
    assert "no such port /dev/ttyNothing7" in line
    assert "allanscope ports" in line
    assert "live sim" in line


def test_a_port_that_another_program_holds(complaint, port):
    holder = (
        "import serial, sys; p = serial.Serial(sys.argv[1], exclusive=True);"
        "print('held', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", holder, port]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as other:
        assert other.stdout.readline() == "held\n"
        code, line = complaint("live", port, *LIVE)
        other.stdin.close()
    assert code == 4
    assert f"{port} is in use by " in line
    assert f"pid {other.pid}" in line
    assert "end that and try again" in line


def test_a_port_without_permission(complaint, monkeypatch):
    def refuse(*_, **__):
        raise serial.SerialException(13, "could not open port: [Errno 13] Permission denied")

    # Root may open anything, so the system's refusal is put in its place.
    monkeypatch.setattr(serial.Serial, "open", refuse)
    code, line = complaint("live", "/dev/ttyACM0", *LIVE)
    assert code == 4
    assert "no permission to open /dev/ttyACM0" in line
    assert "usermod -aG" in line or "udev rule" in line


@pytest.mark.skipif(os.geteuid() == 0, reason="root may open every port")
def test_a_port_whose_mode_forbids(complaint, port):
    os.chmod(port, 0)
    code, line = complaint("live", port, *LIVE)
    assert code == 4
    assert f"no permission to open {port}" in line


def test_a_port_that_is_silent(complaint, port):
    code, line = complaint("live", port, "--view", "none", "--for", "1s", "--wire", "datalog")
    assert code == 4
    assert "no samples received" in line


@pytest.mark.parametrize("place", ["/", "/dev/null"])
def test_what_is_no_port(complaint, place):
    code, line = complaint("live", place, *LIVE)
    assert code in (3, 4)
    assert place in line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("live", "sim", "--part", "LSM9DS1"), ("LSM9DS1", "LSM6DSM")),
        (("live", "sim", "--gyro-fs", "300"), ("300", "250")),
        (("live", "sim", "--wire", "morse"), ("morse", "native")),
        (("live", "sim", "--rate", "-1"), ("-1",)),
        (("live", "sim", "--fault", "fire:at=1"), ("fire", "unplug")),
        (("live", "sim", "--effect", "gremlins:n=1"), ("gremlins", "sinusoid")),
        (("device", "--fault", "stall:seconds=2"), ("stall:at=",)),
        (("simulate", "x.mcap", "--hours", "0"), ("hours",)),
        (("simulate", "x.mcap", "--fault", "bit_flip:rate=1e-3"), ("--fault",)),
        (("live", "sim", "--view", "cinema"), ("cinema", "window", "live --help")),
        (("live", "sim", "--for", "soon"), ("soon", "10m")),
        (("live", "sim", "--seed", "-1"), ("seed", "-1")),
        (("live", "sim", "--unit", "gyro=furlong"), ("furlong", "mdps")),
        (("replay",), ("recording",)),
        (("watch",), ("watch", "analyse")),
        (("live", "sim", "--for", "1m30"), ("1m30", "1h30m")),
        (("live", "sim", "--port", "/dev/ttyACM0"), ("/dev/ttyACM0", "serial port")),
        (("stability",), ("required: QUANTITY;",)),
        (("stability", "mtye"), ("unknown quantity 'mtye'", "mtie")),
        (("stability", "gcodev", "a.csv"), ("gcodev takes 2 inputs, 1 given",)),
        (("stability", "edf", "a.csv"), ("edf takes no inputs, 1 given",)),
        (("convert", "a.csv", "b.csv", "--from", "S_z", "--to", "adev"), ("quantity 'S_z'",)),
        (("chart", "slopes", "nowhere/x.svg"), ("cannot write nowhere/x.svg: No such file",)),
    ],
)
def test_what_does_not_exist_is_refused_before_anything_is_made(complaint, arguments, words):
    extra = LIVE if arguments[:1] == ("live",) else ()
    code, line = complaint(*arguments, *extra)
    assert code == 2
    assert all(word in line for word in words)


def test_the_board_is_looked_for_by_its_usb_number(complaint, monkeypatch):
    monkeypatch.setattr(list_ports, "comports", list)
    code, line = complaint("live", "auto", *LIVE)
    assert code == 4
    for word in ("0483:5740", "374b", "no serial port was found", "allanscope live sim"):
        assert word in line


def test_ports_says_what_auto_would_take(monkeypatch, capsys):
    monkeypatch.setattr(list_ports, "comports", list)
    assert main(["ports"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert "no board found" in line
    assert "allanscope live sim" in line


FILES = {
    "missing.csv": None,
    "empty.csv": b"",
    "picture.png": b"\x89PNG\r\n" + np.random.default_rng(1).bytes(300_000),
    "noise.bin": np.random.default_rng(2).bytes(300_000),
    "cut.gz": b"\x1f\x8b\x08\x00garbage",
    "words.txt": b"no numbers in here\n" * 50,
    "header.csv": HEADER.encode(),
}


@pytest.mark.parametrize("command", [("analyse",), ("recover", "out.mcap")])
def test_an_empty_recording_is_called_empty(complaint, command, tmp_path):
    (tmp_path / "empty.mcap").touch()
    code, line = complaint(command[0], "empty.mcap", *command[1:])
    assert (code, line) == (3, "allanscope: empty.mcap is empty\n")


@pytest.mark.parametrize("command", [("analyse",), ("export", "out.csv")])
def test_a_result_is_not_taken_for_a_table(complaint, command, tmp_path):
    (tmp_path / "result.json").write_text(json.dumps({"schema": "allanscope/1", "rate": [1, 2]}))
    code, line = complaint(command[0], "result.json", *command[1:])
    assert code == 3
    assert "result.json is a result; name its recording" in line


def test_a_table_that_is_missing_is_named_once(complaint):
    code, line = complaint("convert", "missing.csv", "b.csv", "--from", "S_y", "--to", "adev")
    assert code == 3
    assert line == "allanscope: cannot read missing.csv: No such file or directory\n"


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("command", ["analyse", "import"])
def test_a_file_that_holds_no_samples(complaint, command, name, tmp_path):
    if FILES[name] is not None:
        (tmp_path / name).write_bytes(FILES[name])
    code, line = complaint(command, name, *(["out.mcap"] if command == "import" else []))
    assert code == 3
    assert name in line
    assert len(line) < 400


def test_cells_that_cannot_be_read_are_told_with_their_line(complaint, tmp_path):
    (tmp_path / "cells.csv").write_text(HEADER + "\n" + "0.1,0.2,n/a,0.4\n" * 20)
    code, line = complaint("analyse", "cells.csv", "--wire", "text")
    assert code == 3
    assert "cells.csv contains no samples" in line
    assert "line 3 is not a row of the table: '0.1,0.2,n/a,0.4'" in line


def test_a_few_unreadable_rows_are_left_out_and_the_first_is_told(tmp_path):
    rows = ROWS.splitlines(keepends=True)
    rows[99] = "0.95,0.1,0x1,0.3\n"
    (tmp_path / "cells.csv").write_text(HEADER + "".join(rows))
    result = tmp_path / "result.json"
    assert main(["analyse", str(tmp_path / "cells.csv"), "--quiet", "--json", str(result)]) == 0
    told = json.loads(result.read_text())
    assert (told["samples"], told["lost_samples"]) == (599, 1)
    assert any("line 101 is not a row" in remark for remark in told["remarks"])


def test_a_traceback_is_shown_on_request_and_changes_no_exit_code(capsys):
    assert main(["analyse", "missing.csv", "--debug"]) == 3
    assert "Traceback" in capsys.readouterr().err


def test_an_internal_error_is_one_line_too(complaint, monkeypatch):
    def fail():
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("allanscope.sources.describe_ports", fail, raising=False)
    code, line = complaint("ports")
    assert code == 1
    assert "No space left on device; run with --debug" in line
    with pytest.raises(OSError, match="No space"):
        main(["ports", "--debug"])


@pytest.mark.parametrize("name", ["missing", "sim", "auto", "/dev/null"])
@pytest.mark.parametrize("command", ["analyse", "import", "export"])
def test_a_file_is_a_file_whatever_it_is_called(complaint, command, name):
    code, line = complaint(command, name, *(["out.csv"] if command != "analyse" else []))
    assert code == 3
    assert name in line


def test_a_recording_is_not_imported_once_more(complaint, tmp_path):
    assert main(["simulate", str(tmp_path / "a.mcap"), "--hours", "0.001", "--quiet"]) == 0
    code, line = complaint("import", "a.mcap", "b.mcap")
    assert code == 3
    assert "a.mcap is a recording already" in line


def test_a_replay_cannot_be_kept_in_a_file(complaint, tmp_path):
    assert main(["simulate", str(tmp_path / "a.mcap"), "--hours", "0.001", "--quiet"]) == 0
    (tmp_path / "b.mcap").write_bytes(b"another file")
    for out, why in (("a.mcap", "a.mcap is read"), ("b.mcap", "cannot make the folder b.mcap")):
        code, line = complaint("replay", "a.mcap", "--view", "none", "--out", out)
        assert code == 2
        assert why in line


def test_a_folder_that_is_no_session(complaint, tmp_path):
    (tmp_path / "photos").mkdir()
    code, line = complaint("analyse", "photos")
    assert code == 3
    assert "photos" in line


def test_a_session_is_never_overwritten(complaint, tmp_path):
    (tmp_path / "session").mkdir()
    (tmp_path / "session" / "session.mcap").write_bytes(b"precious")
    code, line = complaint("live", "sim", *LIVE)
    assert code == 2
    assert "already contains a session" in line
    assert (tmp_path / "session" / "session.mcap").read_bytes() == b"precious"


def test_a_place_that_cannot_be_written_to_is_refused_before_the_work(complaint, monkeypatch):
    monkeypatch.setattr(
        "allanscope.pipeline.analyse_file.analyse_input", lambda *_: pytest.fail("late")
    )
    for call in (["analyse", "a.mcap", "--json", "no/x.json"], ["report", "S", "--out", "."]):
        code, line = complaint(*call)
        assert code == 2
        assert line.startswith("allanscope: cannot write ")
        assert line.endswith("; choose another place\n")


def test_times_that_go_down_are_not_called_missing(complaint, tmp_path):
    backwards = "".join(reversed(ROWS.splitlines(keepends=True)))
    (tmp_path / "backwards.csv").write_text(HEADER + backwards)
    code, line = complaint("analyse", "backwards.csv", "--quiet")
    assert code == 2
    assert "or none that go up" in line


def test_a_time_that_goes_back_is_said_with_what_it_is_taken_for(tmp_path):
    """Once: the device restarted. A single stamp: that row is wrong. All along: no times."""
    cases = {
        "once": (lambda i: i / 104 - 20.0 * (i >= 300), (), "sample 300, time -17.1154 s: the"),
        "single": (lambda i: i / 104 - 0.05 * (i == 300), (), "does not fit the next row"),
        "all along": (lambda i: -i / 104, (104.0,), "the times go back from row to row"),
    }
    for name, (time_of, rate, words) in cases.items():
        rows = "".join(f"{time_of(i):.6f},0.1,0.2,0.{i % 7}\n" for i in range(600))
        (tmp_path / "back.csv").write_text(HEADER + rows)
        device = DeviceSettings(rate_hz=rate[0] if rate else None)
        result = analyse_input(tmp_path / "back.csv", device, quiet=True)
        said = [*result.remarks, *result.assumptions]
        assert sum(words in remark for remark in said) == 1, (name, said)
        assert (result.unknown_losses, result.samples) == {
            "once": (1, 600),
            "single": (0, 599),
            "all along": (0, 600),
        }[name]


@pytest.mark.parametrize("size", ["1e300", "1e199", "1e10"])
def test_a_number_that_no_sensor_reads_is_named(complaint, tmp_path, size):
    """One row is left out, and said; where all are so large that is the reason."""
    rows = ROWS.splitlines(keepends=True)
    rows[99] = f"{99 / 104:.6f},0.1,{size},0.3\n"
    (tmp_path / "one.csv").write_text(HEADER + "".join(rows))
    result = analyse_input(tmp_path / "one.csv", DeviceSettings(), quiet=True)
    assert (result.samples, result.lost_samples) == (599, 1)
    assert any("sample 99, time 0.951923 s: its values" in remark for remark in result.remarks)
    (tmp_path / "all.csv").write_text(HEADER + ROWS.replace(",0.2,", f",{size},"))
    code, line = complaint("analyse", "all.csv")
    assert code == 3
    assert f"line 2, column 3: '{size}' is more than any sensor reads" in line
    assert "cells where the header" not in line, "the line that was cut is no reason"
    for kind in ("npz", "parquet"):
        name = f"all.{kind}"
        columns = {"gx": np.full(600, float(size)), "t": np.arange(600) / 104}
        if kind == "npz":
            np.savez(tmp_path / name, **columns)
        else:
            pq.write_table(pa.table(columns), tmp_path / name)
        code, line = complaint("analyse", name, "--rate", 104)
        assert (code, "more than any sensor reads" in line) == (3, True), line


def test_noise_of_any_size_gives_a_result_without_a_warning(tmp_path):
    """Below 1e-50 it is 0: its fourth power would be."""
    white = np.random.default_rng(1).normal(0.0, 1.0, 2000)
    for size in (1e8, 1e-40, 1e-60, 1e-300):
        np.savetxt(tmp_path / "a.csv", white * size, header="gx[dps]", comments="")
        from_text = analyse_input(tmp_path / "a.csv", DeviceSettings(rate_hz=104.0), quiet=True)
        for result in (from_text, analyse({"gx": white * size}, 104.0)):
            assert not result.axes["gx"].failure
            first = result.axes["gx"].curves["oadev"].deviation[0]
            assert first == pytest.approx(size if size >= 1e-50 else 0.0, 0.1, 0.0)


def test_an_axis_that_changes_only_at_a_gap_is_constant():
    """Its spectrum is of rounding errors: of 211 times 1.3 the mean is not 1.3."""
    values, times = np.repeat([5.0, 1.3], [8, 211]), np.arange(219) / 104
    times[8:] += 5.0
    axis = analyse({"az[g]": values, "t": times}).axes["az"]
    assert not axis.failure
    assert not axis.coefficients


def test_spikes_on_a_constant_axis_with_gaps_overflow_nowhere():
    """Some spectra are zero, so that nothing is expected where a ramp is looked for."""
    values, times = np.zeros(1500), np.arange(1500) / 100
    values[[309, 741]] = 65536.0, 1e9
    for gap in (300, 340, 413, 445, 558, 639, 921, 949, 1182, 1324, 1356):
        times[gap:] += 5.0
    assert not analyse({"gz[dps]": values, "t": times}).axes["gz"].failure


def test_a_warning_of_numpy_is_for_those_who_debug(monkeypatch, capsys):
    def divide():
        return [str(np.float64(1.0) / np.float64(0.0))]

    monkeypatch.setattr("allanscope.sources.describe_ports", divide, raising=False)
    monkeypatch.setattr(sys, "argv", ["allanscope", "ports"])
    with warnings.catch_warnings():
        assert main() == 0
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys, "argv", ["allanscope", "ports", "--debug"])
    with pytest.raises(RuntimeWarning, match="divide by zero"):
        main()


def test_what_is_stopped_before_its_end_says_so(complaint, monkeypatch):
    """A session that is ended leaves its result, all else leaves none: no gate may take it so."""

    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("allanscope.pipeline.analyse_file.analyse_input", stopped)
    code, line = complaint("analyse", "night.mcap")
    assert (code, line) == (130, "allanscope: stopped before it was done\n")


def test_what_a_table_did_not_say_stands_in_the_result(tmp_path):
    """Whoever reads N must know that its scale was a guess."""
    counts = np.random.default_rng(1).integers(-9, 9, (600, 3))
    np.savetxt(tmp_path / "bare.txt", counts, "%d", ",")
    result = analyse_input(tmp_path / "bare.txt", DeviceSettings(rate_hz=104.0), quiet=True)
    said = " ".join(result.assumptions)
    assert [line.head for line in verdict(result).details[:3]] == ["Assumed"] * 3
    assert result.to_dict()["assumptions"] == list(result.assumptions)
    assert not set(result.assumptions) & set(result.remarks)
    for assumed in ("3 columns, assumed to be gx gy gz", "counts (lsb) assumed", "250 dps assumed"):
        assert assumed in said


@pytest.mark.parametrize("rate", [(), ("--rate", 104)])
def test_too_few_samples_for_any_curve_are_input_that_cannot_be_used(complaint, tmp_path, rate):
    (tmp_path / "three.csv").write_text(HEADER + "0,1,2,3\n0,1,2,4\n-1,2,2,2\n")
    code, line = complaint("analyse", "three.csv", *rate)
    assert code == 3
    assert "3 samples are too few for any curve; record for longer" in line


def test_text_that_fits_no_format_is_named_by_line_and_column(complaint, tmp_path):
    (tmp_path / "odd.csv").write_text(HEADER + "0,0.1,none,0.2\n" * 9)
    code, line = complaint("analyse", "odd.csv")
    assert code == 3
    assert "line 2, column 3: 'none' is not a number; line 3, column 3" in line


def test_an_axis_that_fails_leaves_the_others_whole(tmp_path, monkeypatch, capsys):
    """Result and report are written; code and remark say that one axis is missing."""
    from allanscope.explain import loop

    search = loop.close_loop

    def failing(view, budget):
        if view.axis == "gy":
            np.average([], weights=[])
        return search(view, budget)

    monkeypatch.setattr(loop, "close_loop", failing)
    rows = np.random.default_rng(5).normal(0, 0.04, (6000, 3))
    np.savetxt(tmp_path / "a.csv", rows, "%.6f", ",", header="gx[dps],gy[dps],gz[dps]", comments="")
    monkeypatch.chdir(tmp_path)
    arguments = ("--json", "a.json", "--report", "a.html", "--rate", "104", "--quiet")
    code = main(["analyse", "a.csv", *arguments])
    assert code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("allanscope: the analysis of gy failed: ZeroDivisionError")
    axes = json.loads((tmp_path / "a.json").read_text())["axes"]
    assert [axis["failure"] is None for axis in axes.values()] == [True, False, True]
    assert axes["gy"]["residual"]["explained"] is False
    assert axes["gy"]["curves"]["oadev"]["tau"] == axes["gx"]["curves"]["oadev"]["tau"]
    assert axes["gx"]["residual"]["explained"] is axes["gz"]["residual"]["explained"] is True
    assert any("ZeroDivisionError" in remark for remark in axes["gy"]["remarks"])
    page = (tmp_path / "a.html").read_text()
    assert "Analysis of gy failed" in page
    assert "an axis failed" in page
