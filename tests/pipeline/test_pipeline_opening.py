"""`allanscope open`, and the page that stays: on the loopback only, nothing fetched, one port."""

import http.client
import json
import re
import shutil
import signal
import subprocess
import time
from contextlib import ExitStack

import psutil
import pytest

from allanscope.errors import InputError, UsageError
from allanscope.pipeline import DeviceSettings, SimulatedSettings, simulate_recording
from allanscope.pipeline.outputs import charts_of
from allanscope.view.viewer_page import policy, without_links
from allanscope.view.viewer_process import _environment, free_port, rerun_binary
from support.browser import drawn, why_no_browser
from support.headless_viewer import why_no_viewer
from support.netlog import NETLOG, asked_for
from support.serving import listening, serving, wait_for


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("night") / "night.mcap"
    simulate_recording(path, 8.0 / 3600.0, DeviceSettings(), SimulatedSettings(seed=3), quiet=True)
    return path


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Return the folder of a session with charts of one value."""
    import rerun as rr

    folder = tmp_path_factory.mktemp("session")
    stream = rr.RecordingStream("allanscope")
    stream.save(folder / "session.rrd")
    stream.log("/x", rr.Scalars(1.0))
    stream.disconnect()
    return folder


@pytest.fixture
def start():
    """Start a command that serves a page; return its process and the match of the address."""
    with ExitStack() as started:

        def start(*arguments):
            return started.enter_context(serving(*arguments, seconds=60.0))

        yield start


def fetched(port, path="/"):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", path)
    answer = connection.getresponse()
    return answer.status, answer.headers, answer.read()


def connected(port):
    """Return whether a program is connected to a port of this machine."""
    return any(
        one.raddr and one.raddr.port == port and one.status == "ESTABLISHED"
        for one in psutil.net_connections("tcp")
    )


def pair_of_ports():
    while True:
        port = free_port()
        if port < 65534 and free_port() != port + 1:
            return port


def test_a_session_is_opened_at_the_ports_that_were_chosen_on_loopback_only(session, start):
    port = pair_of_ports()
    process, found = start("open", session, "--view", "web", "--port", port)
    assert (int(found[2]), int(found[3])) == (port, port + 1)
    assert wait_for(lambda: {at for _, at in listening(process)} >= {port, port + 1})
    assert {ip for ip, _ in listening(process)} == {"127.0.0.1"}
    status, headers, page = fetched(port)
    assert status == 200
    assert headers["Content-Security-Policy"] == policy(port + 1)
    assert b"re_viewer" in page
    assert not re.search(rb"<link[^>]*https?:", page), "no font, no connection ahead"
    assert fetched(port, "/re_viewer.js")[0] == 200
    assert fetched(port, "/nothing")[0] == 404
    process.send_signal(signal.SIGINT)
    assert process.wait(20) == 0
    assert wait_for(lambda: not _answers(port + 1)), "the viewer has ended as well"


def _answers(port):
    try:
        fetched(port)
    except OSError:
        return False
    return True


def test_the_page_of_a_replay_stays_until_it_is_ended(recording, start, tmp_path):
    port = pair_of_ports()
    replay = ("replay", recording, "--view", "web", "--port", port, "--out", tmp_path / "again")
    process, found = start(*replay)
    assert (int(found[2]), int(found[3])) == (port, port + 1)
    said = iter(process.stdout.readline, "")
    assert any("stay available until Ctrl-C" in line for line in said)
    assert json.loads((tmp_path / "again" / "result.json").read_text("utf-8"))["samples"] > 0
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(2.0)
    assert fetched(port)[0] == 200
    assert {ip for ip, _ in listening(process)} == {"127.0.0.1"}
    assert (("127.0.0.1", port + 1)) in listening(process), "its data are still served"
    process.send_signal(signal.SIGINT)
    assert process.wait(30) == 0
    assert (tmp_path / "again" / "session.rrd").stat().st_size > 0


def test_a_port_that_is_taken_is_refused(session, run):
    import socket

    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        ran = run("open", session, "--view", "web", "--port", port, code=2)
    assert f"port {port}" in ran.stderr
    assert ran.stderr.count("\n") == 1


def test_what_is_no_session_is_refused_with_what_to_do(session, recording, tmp_path):
    assert charts_of(str(session)) == str(session / "session.rrd")
    assert charts_of(str(session / "session.rrd")) == str(session / "session.rrd")
    here = "rerun+http://127.0.0.1:9876/proxy"
    assert charts_of(here) == here
    for nothing in (tmp_path, recording, tmp_path / "none.rrd"):
        with pytest.raises(InputError, match="allanscope replay"):
            charts_of(str(nothing))
    for elsewhere in ("rerun+http://10.0.0.1:9876/proxy", "https://example.com/x.rrd"):
        with pytest.raises(UsageError, match="not an address of this machine"):
            charts_of(elsewhere)


def test_links_to_other_hosts_are_taken_out_and_others_stay():
    page = b'<link rel="icon" href="favicon.ico" /><link\n href="https://a/b"\n rel="x"\n/>text'
    assert without_links(page) == b'<link rel="icon" href="favicon.ico" />text'


@pytest.mark.skipif(bool(why_no_browser()), reason=why_no_browser() or "-")
def test_the_page_fetches_nothing_from_other_hosts(session, start, tmp_path):
    process, found = start("open", session, "--view", "web")
    address, port = found[1], int(found[3])
    log = tmp_path / "net.json"
    options = (
        "--window-size=400,300",
        NETLOG.format(log),
        # No name is looked up: a test leaves nothing behind in the network.
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    )
    with drawn(address, tmp_path, *options):
        assert wait_for(lambda: connected(port), 150.0), "the page fetches its data"
        # Rerun's own page asks for its latest release, and whether it may report, at this time.
        time.sleep(10.0)
        assert process.poll() is None
    asked = {url for _, url in asked_for(log)}
    assert any(url.startswith(f"http://127.0.0.1:{port}/") for url in asked)
    assert {url for url in asked if not url.startswith("http://127.0.0.1:")} == set()


@pytest.mark.skipif(bool(why_no_viewer()), reason=why_no_viewer() or "-")
@pytest.mark.skipif(not shutil.which("strace"), reason="strace is not installed")
def test_the_window_reports_nothing_and_asks_no_other_host(session, tmp_path):
    """Seen by the system calls of the viewer, without a window but otherwise as it is started."""
    calls, home = tmp_path / "calls", tmp_path / "home"
    home.mkdir()
    outside = {name: str(home) for name in ("HOME", "XDG_RUNTIME_DIR")}
    trace = ["strace", "-f", "-qq", "-e", "trace=connect", "-o", str(calls)]
    command = [str(rerun_binary()), "--headless", "--bind", "127.0.0.1", "--port", str(free_port())]
    process = subprocess.Popen(
        [*trace, *command, str(session / "session.rrd")],
        env=_environment() | outside,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )

    def connections():
        known = calls.read_text("utf-8", "replace") if calls.exists() else ""
        return [line for line in known.splitlines() if "AF_INET" in line]

    try:
        asked = wait_for(lambda: any("htons(9)" in one for one in connections()), 60.0)
        if not asked and process.poll() is not None:
            pytest.skip("this machine allows no tracing")
    finally:
        for child in psutil.Process(process.pid).children(True):
            child.terminate()
        process.terminate()
        process.wait(20)
    assert connections()
    assert [one for one in connections() if '"127.0.0.1"' not in one] == []
    assert not list(home.rglob("analytics*"))
