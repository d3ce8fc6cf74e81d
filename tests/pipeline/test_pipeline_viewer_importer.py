"""The importer that lets the Rerun viewer open a recording by itself."""

import importlib.metadata
import os
import subprocess
import sys

import pytest

from allanscope.pipeline import DeviceSettings, SimulatedSettings, simulate_recording
from allanscope.pipeline.rerun_importer import NOT_OURS, is_ours, main
from support.headless_viewer import HeadlessViewer, why_no_viewer
from support.readback import read_back

NAME = "rerun-importer-allanscope"
FOREIGN = b"\x89MCAP0\r\n\x01\x10\x00\x00\x00\x00\x00\x00\x00\x04\x00\x00\x00ros2"
SCRIPT = f"#!{sys.executable}\nimport sys\nfrom allanscope.pipeline.rerun_importer import main\n"
REFUSE = """
import sys
from allanscope.pipeline.rerun_importer import main
code = main(sys.argv[1:])
heavy = {"numpy", "rerun", "scipy", "mcap", "rich", "allanscope.recording"}
print(code, sorted(heavy & set(sys.modules)))
"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("importer") / "night.mcap"
    simulate_recording(path, 8.0 / 3600.0, DeviceSettings(), SimulatedSettings(seed=3), quiet=True)
    return path


@pytest.fixture(scope="module")
def on_path(tmp_path_factory):
    """Return a folder that holds the importer under the name that the viewer looks for."""
    folder = tmp_path_factory.mktemp("bin")
    program = folder / NAME
    program.write_text(f"{SCRIPT}sys.exit(main())\n")
    program.chmod(0o755)
    return folder


def test_only_recordings_of_ours_are_taken(recording, tmp_path):
    foreign = tmp_path / "foreign.mcap"
    foreign.write_bytes(FOREIGN)
    assert is_ours(recording)
    assert not is_ours(foreign)
    assert not is_ours(tmp_path)
    assert not is_ours(tmp_path / "missing.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recording.read_bytes()[:20])
    assert not is_ours(cut)


def test_a_foreign_file_is_refused_before_anything_heavy_is_imported(tmp_path):
    foreign = tmp_path / "foreign.mcap"
    foreign.write_bytes(FOREIGN)
    ran = subprocess.run(
        [sys.executable, "-c", REFUSE, str(foreign), "--recording-id", "x", "--unknown", "y"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert ran.stdout.split(maxsplit=1) == [str(NOT_OURS), "[]\n"]
    assert ran.stderr == ""


def test_the_program_is_installed_under_the_name_that_the_viewer_looks_for():
    (script,) = importlib.metadata.entry_points(group="console_scripts", name=NAME)
    assert script.load() is main


def test_what_is_written_is_what_a_live_viewer_would_have_been_shown(recording, on_path, tmp_path):
    out = tmp_path / "out.rrd"
    with out.open("wb") as file:
        subprocess.run(
            [on_path / NAME, recording, "--application-id", "a", "--recording-id", "b"],
            stdout=file,
            timeout=110,
            check=True,
        )
    rows = read_back(out)
    times = [row.elapsed_s for row in rows["/gx/allan/oadev"]]
    assert len(set(times)) > 5, "history can be scrubbed"
    assert times[-1] == pytest.approx(8.0, abs=0.3)
    assert "/gz/allan/theoh" in rows, "the last result is the full one"
    assert len(rows["/samples/gyro"]) > 70
    assert "of gyroscope" in rows["/tables/verdict"][-1].values["TextDocument:text"][0]


@pytest.mark.skipif(bool(why_no_viewer()), reason=why_no_viewer() or "-")
def test_the_viewer_opens_a_recording_by_itself(recording, on_path, monkeypatch, tmp_path):
    # The viewer's own reader takes everything that is called .mcap.
    named = tmp_path / "night.allanscope"
    named.symlink_to(recording)
    monkeypatch.setenv("PATH", f"{on_path}{os.pathsep}{os.environ['PATH']}")
    with HeadlessViewer(str(named), "1200x800") as viewer:
        state = viewer.wait(7.5, timeout_s=100.0)
    assert {"verdict", "gx", "az"} <= {view.name for view in state.views}
    assert not [report for view in state.views for report in view.reports]
