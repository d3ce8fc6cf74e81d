"""A whole session as a user runs it: live on a simulated device, recorded, replayed, analysed."""

import json
import re
from functools import partial

import allantools
import numpy as np
import pytest

from allanscope.__main__ import main
from allanscope.pipeline import Decoding
from allanscope.recording import Recording
from allanscope.samples import Block
from allanscope.wire import WireSettings
from support.readback import read_back


@pytest.fixture(scope="module")
def session(run, tmp_path_factory):
    """Return the folder and the printed result of a short live session."""
    folder = tmp_path_factory.mktemp("live") / "session"
    ran = run("live", "sim", "--for", "8s", "--view", "none", "--out", folder, "--json")
    return folder, json.loads(ran.stdout)


def decoded(folder):
    """Return the counts that a recording holds."""
    decoding = Decoding(WireSettings())
    blocks = []
    for chunk in Recording(folder).chunks():
        blocks += [event for event in decoding.feed(chunk) if isinstance(event, Block)]
    return np.concatenate([block.counts for block in blocks])


def test_a_live_session_leaves_recording_view_result_and_report(session):
    folder, printed = session
    assert sorted(path.name for path in folder.iterdir()) == [
        "report.html",
        "result.json",
        "session.mcap",
        "session.rrd",
    ]
    assert json.loads((folder / "result.json").read_text()) == printed
    assert printed["schema"] == "allanscope/1"
    assert printed["lost_samples"] == 0
    assert printed["axes"]["gx"]["coefficients"]["N"]["detected"]


def test_the_result_tells_which_recording_it_is_of(session):
    folder, printed = session
    recording = Recording(folder)
    assert printed["input"]["sha256"] == recording.sha256()
    assert printed["input"]["started"] == recording.metadata["started"]


def test_curves_agree_with_allantools_on_the_same_samples(session):
    """To 1e-12, and to 1e-14 where allantools is given the exact phase.

    allantools sums the rates in floating point, which costs it some digits where there is a large
    mean: 1 g. An integer taken off every count drops out of all differences and keeps phases
    small, so that its sums are exact as well.
    """
    folder, result = session
    counts = decoded(folder)
    assert len(counts) == result["samples"]
    rate = result["rate"]["measured_hz"] or result["rate"]["nominal_hz"]
    for column, name in enumerate(result["axes"]):
        scale = 4.375e-3 if name.startswith("g") else 0.061e-3
        axis = counts[:, column].astype(np.int64)
        phase = np.concatenate([[0], np.cumsum(axis - round(axis.mean()))]) / rate
        for kind in ("oadev", "adev", "mdev", "ohdev"):
            curve = result["axes"][name]["curves"][kind]
            m = np.rint(np.array(curve["tau"]) * rate)
            keep = m < 64
            estimate = partial(getattr(allantools, kind), rate=rate, taus=m[keep] / rate)
            measured = np.array(curve["deviation"])[keep]
            _, expected, _, _ = estimate(axis * scale, data_type="freq")
            np.testing.assert_allclose(measured, expected, rtol=1e-12)
            _, expected, _, _ = estimate(phase, data_type="phase")
            np.testing.assert_allclose(measured, expected * scale, rtol=1e-14)


def test_the_viewers_file_of_a_live_run_shows_the_values_of_its_result(session):
    folder, result = session
    shown = read_back(folder / "session.rrd")
    for sensor, axes, factor in (("gyro", "xyz", 1e3), ("accel", "xyz", 1e6)):
        names = [sensor[0] + axis for axis in axes]
        # Positions are logarithms on the chart's own scale: one straight line for all three axes.
        drawn, curves = [], []
        for name in names:
            dots = shown[f"/{name}/allan/oadev/points"][-1].dots()
            dots = dots[np.argsort(dots[:, 0])]
            curve = result["axes"][name]["curves"]["oadev"]
            assert len(dots) > 10
            drawn.append(dots)
            curves.append(np.log10([curve["tau"], curve["deviation"]])[:, : len(dots)].T)
        points, values = np.concatenate(drawn), np.concatenate(curves)
        for column in (0, 1):
            line = np.polyfit(values[:, column], points[:, column], 1)
            off = np.polyval(line, values[:, column]) - points[:, column]
            assert np.abs(off / line[0]).max() < 1e-4  # decades
        known = [result["axes"][name]["coefficients"]["N"]["value"] for name in names]
        plotted = shown[f"/coefficients/{sensor}/N"][-1].values["Measurements:values"]
        np.testing.assert_allclose(plotted, np.multiply(known, factor), rtol=1e-6)
    lost = shown["/link/lost"][-1].values["Scalars:scalars"]
    assert lost == [result["lost_samples"], result["unknown_losses"]]
    errors = shown["/link/errors"][-1].values["Scalars:scalars"]
    assert errors == [result["link"][name] for name in ("crc_errors", "resyncs", "reconnects")]


def test_replay_gives_the_same_curves_bit_for_bit(run, session):
    folder, result = session
    again = json.loads(run("replay", folder, "--view", "none", "--json").stdout)
    for name, axis in result["axes"].items():
        assert again["axes"][name]["curves"] == axis["curves"]
    assert again["rate"] == result["rate"]


def test_analyse_gives_the_same_curves_and_a_report(run, session, tmp_path):
    folder, result = session
    report = tmp_path / "report.html"
    ran = run("analyse", folder / "session.mcap", "--json", "-", "--report", report)
    again = json.loads(ran.stdout)
    assert again["axes"]["ay"]["curves"] == result["axes"]["ay"]["curves"]
    text = report.read_text()
    assert "<script" not in text
    outside = re.findall(r"https?://[^\s\"<]+", text)
    assert set(outside) <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert text.count("<svg") > 12


def test_an_export_is_read_back_with_the_same_counts(run, session, tmp_path):
    folder, result = session
    told = run("export", folder, tmp_path / "out.csv").stdout
    assert f"{result['samples']} samples" in told
    again = json.loads(run("analyse", tmp_path / "out.csv", "--json", "-", "--quiet").stdout)
    assert again["samples"] == result["samples"]


@pytest.mark.parametrize("wire", ["tmsg", "datalog"])
@pytest.mark.usefixtures("undrawn")
def test_stock_firmware_is_started_recognised_and_recorded(wire, tmp_path, capsys):
    where = ("--view", "none", "--out", str(tmp_path / "session"))
    assert main(["live", "sim", "--wire", wire, "--for", "3s", *where, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["input"]["wire"] == wire
    assert result["samples"] > 50


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (("live", "/dev/ttyNothing", "--view", "none"), 4, "/dev/ttyNothing"),
        (("live", "sim", "--part", "LSM9DS1"), 2, "LSM9DS1"),
        (("analyse", "missing.mcap"), 3, "missing.mcap"),
        (("analyse", "EMPTY"), 3, "empty"),
        (("analyse", "PICTURE"), 3, "none of the formats"),
    ],
)
def test_bad_input_is_one_clear_line_and_leaves_nothing(
    run, arguments, code, word, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    noise = np.random.default_rng(1).integers(0, 256, 300_000).astype(np.uint8)
    (tmp_path / "EMPTY").write_bytes(b"")
    (tmp_path / "PICTURE").write_bytes(b"\x89PNG" + noise.tobytes())
    before = sorted(path.name for path in tmp_path.iterdir())
    ran = run(*arguments, code=code)
    (said,) = ran.stderr.splitlines()
    assert word in said
    assert sorted(path.name for path in tmp_path.iterdir()) == before
