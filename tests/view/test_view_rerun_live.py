"""The viewer may be absent, stopped, closed or late: the measurement goes on, the file is whole."""

import os
import signal
import socket
import stat
import urllib.request
from dataclasses import replace
from pathlib import Path

import pytest

import allanscope.view.rerun_recording as canvas
from allanscope.errors import DeviceError
from allanscope.view import RerunView, ViewerProcess, has_display, viewer_process
from allanscope.view.viewer_process import free_port, optimise
from support.demo_analysis import demo_analysis
from support.demo_session import perform
from support.headless_viewer import HeadlessViewer, why_no_viewer
from support.readback import read_back

needs_viewer = pytest.mark.skipif(bool(why_no_viewer()), reason=why_no_viewer() or "-")


class NoViewer:
    """Stands for a viewer that nobody ever opens."""

    address = ""
    exit_code = None

    def __init__(self, uri, web, port=None):
        self.uri, self.web = uri, web

    def running(self):
        return self.exit_code is None

    def failed(self):
        return bool(self.exit_code)

    def stop(self):
        self.exit_code = 0


@pytest.fixture
def served(tmp_path, monkeypatch):
    """Return a view that serves data but opens no viewer."""
    monkeypatch.setattr(viewer_process, "ViewerProcess", NoViewer)
    view = RerunView(tmp_path, "window")
    view.start()
    yield view
    view.close()


def test_without_a_viewer_the_file_is_complete(served, tmp_path):
    perform(served, 6.0)
    assert served.settle(60.0)
    served.close()
    rows = read_back(tmp_path / "session.rrd")
    assert len([r for r in rows["/samples/gyro"] if r.elapsed_s is not None]) >= 58


@needs_viewer
def test_a_viewer_that_was_stopped_holds_up_nothing(served, tmp_path):
    with HeadlessViewer(served.address, "640x480") as viewer:
        perform(served, 3.0)
        viewer.wait(2.0)
        os.kill(viewer.pid, signal.SIGSTOP)
        try:
            result = demo_analysis(3.0)
            for second in range(4, 19):  # some 6 MB, more than any buffer on the way holds
                served.snapshot(replace(result, duration_s=float(second)))
                assert served.settle(60.0)
            assert served.dropped == 0
        finally:
            os.kill(viewer.pid, signal.SIGCONT)
    served.close()
    rows = read_back(tmp_path / "session.rrd")
    assert rows["/gx/allan/oadev"][-1].elapsed_s == 18.0


@needs_viewer
def test_a_viewer_that_joins_late_gets_curves_grids_and_layout(served):
    perform(served, 5.0)
    assert served.settle(60.0)
    assert served.flush(60.0)
    with HeadlessViewer(served.address, "640x480") as viewer:
        state = viewer.wait(5.0)
        assert {"gx", "ay", "effects found", "state of the link"} <= {v.name for v in state.views}
        assert not [report for view in state.views for report in view.reports]


@needs_viewer
def test_the_last_result_still_reaches_an_open_viewer_when_the_run_ends(served):
    with HeadlessViewer(served.address, "640x480") as viewer:
        perform(served, 3.0)
        viewer.wait(2.0)
        served.close(demo_analysis(77.0))
        assert viewer.wait(77.0).views


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="reads Linux's table of ports")
def test_the_server_listens_on_the_loopback_interface_only(served):
    port = int(served.address.partition("127.0.0.1:")[2].partition("/")[0])
    table = Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()
    local = [line.split()[1] for line in table if line.split()[3] == "0A"]
    mine = [entry for entry in local if entry.endswith(f":{port:04X}")]
    assert mine == [f"0100007F:{port:04X}"]


def test_a_port_that_was_taken_in_the_meantime_is_replaced(monkeypatch):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        ports = iter([taken.getsockname()[1], free_port()])
        monkeypatch.setattr(canvas, "free_port", lambda: next(ports))
        recording, address = canvas.open_server("demo")
        assert f":{taken.getsockname()[1]}/" not in address
        recording.disconnect()


def test_without_any_free_port_the_error_says_what_to_do(monkeypatch):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        monkeypatch.setattr(canvas, "free_port", lambda: taken.getsockname()[1])
        with pytest.raises(DeviceError, match=r"no free port on 127\.0\.0\.1; use --view none"):
            canvas.open_server("demo")


def test_the_web_viewer_is_served_on_loopback_until_the_end(tmp_path, monkeypatch):
    monkeypatch.setattr(viewer_process, "has_display", lambda: False)
    said = []
    view = RerunView(None, "web", say=said.append)
    view.start()
    try:
        page = view.viewer.process.address
        assert said == [f"charts: {page}"]
        assert page.startswith("http://127.0.0.1:")
        assert "url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A" in page
        body = _get(page, view.viewer.process)
        assert b"Rerun" in body
        assert view.viewer.process.running()
    finally:
        view.close()
    assert not view.viewer.process.running()


def test_a_browser_is_opened_only_where_there_is_a_display(monkeypatch):
    opened = []
    monkeypatch.setattr(viewer_process, "ViewerProcess", NoViewer)
    monkeypatch.setattr(viewer_process.webbrowser, "open", opened.append)
    for display in (False, True):
        monkeypatch.setattr(viewer_process, "has_display", lambda display=display: display)
        view = RerunView(None, "web")
        view.start()
        view.close()
        assert len(opened) == int(display)


@pytest.mark.parametrize("display", [True, False])
def test_auto_is_a_window_where_there_is_a_display(monkeypatch, display):
    monkeypatch.setattr(viewer_process, "ViewerProcess", NoViewer)
    monkeypatch.setattr(viewer_process, "has_display", lambda: display)
    monkeypatch.setattr(viewer_process.webbrowser, "open", lambda page: None)
    view = RerunView(None, "auto")
    view.start()
    assert view.viewer.process.web is not display
    view.close()


def test_a_display_is_recognised_by_its_variables(monkeypatch):
    monkeypatch.setattr(viewer_process.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert not has_display()
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    assert has_display()


def test_that_the_viewer_was_closed_is_said_once(monkeypatch):
    monkeypatch.setattr(viewer_process, "ViewerProcess", NoViewer)
    said = []
    view = RerunView(None, "window", say=said.append)
    view.start()
    view.viewer.process.exit_code = 0
    view.snapshot(demo_analysis(1.0))
    view.snapshot(demo_analysis(2.0))
    view.close()
    assert said[1:] == [
        f"viewer closed, still measuring; to open it again: allanscope open {view.address}"
    ]


def test_a_window_that_cannot_live_is_replaced_by_the_web_viewer(monkeypatch):
    monkeypatch.setattr(viewer_process, "ViewerProcess", NoViewer)
    monkeypatch.setattr(viewer_process, "has_display", lambda: True)
    monkeypatch.setattr(viewer_process.webbrowser, "open", lambda page: None)
    view = RerunView(None, "auto")
    view.start()
    assert view.viewer.process.web is False
    view.viewer.process.exit_code = 1
    view.snapshot(demo_analysis(1.0))
    assert view.viewer.process.web is True
    view.close()


def test_the_viewer_is_a_process_group_of_its_own_and_sends_no_telemetry(tmp_path, monkeypatch):
    fake = tmp_path / "rerun"
    fake.write_text(f'#!/bin/sh\necho "$CI $*" > {tmp_path}/seen\nexec sleep 60\n')
    fake.chmod(fake.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr(viewer_process, "rerun_binary", lambda: fake)
    window = ViewerProcess("rerun+http://127.0.0.1:1/proxy", web=False)
    try:
        assert os.getpgid(window.pid) == window.pid, "Ctrl-C must not reach it"
        while not (tmp_path / "seen").exists() or not (tmp_path / "seen").read_text():
            assert window.running()
        seen = (tmp_path / "seen").read_text()
    finally:
        window.stop()
    assert seen.startswith("true ")
    assert "--bind 127.0.0.1" in seen
    assert "--connect rerun+http://127.0.0.1:1/proxy" in seen
    assert not window.running()


def test_a_missing_viewer_is_an_error_that_says_what_to_do(monkeypatch):
    monkeypatch.setattr(viewer_process.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(DeviceError, match="pip install rerun-sdk, or use --view none"):
        viewer_process.rerun_binary()


def test_a_file_that_cannot_be_optimised_is_left_alone(tmp_path):
    path = tmp_path / "session.rrd"
    path.write_bytes(b"no recording")
    assert optimise(path) is False
    assert path.read_bytes() == b"no recording"
    assert list(tmp_path.iterdir()) == [path]
    assert optimise(tmp_path / "absent.rrd") is False


def _get(page, viewer):
    while True:
        try:
            with urllib.request.urlopen(page, timeout=10) as answer:
                return answer.read()
        except OSError:
            assert viewer.running()
