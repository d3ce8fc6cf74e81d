"""The web viewer of a live run: on loopback only, its address printed, and a browser connects."""

import psutil
import pytest

from support.browser import drawn, why_no_browser
from support.serving import listening, serving, wait_for


@pytest.fixture
def live(tmp_path):
    """Start a live run with the web viewer; return its process and what it said of the page."""
    session = tmp_path / "session"
    with serving("live", "sim", "--view", "web", "--out", session, seconds=100.0) as started:
        yield started


def connected(port):
    """Return the programs that are connected to a port of this machine."""
    return {
        psutil.Process(one.pid).name()
        for one in psutil.net_connections("tcp")
        if one.raddr and one.raddr.port == port and one.pid and one.status == "ESTABLISHED"
    }


def test_the_page_is_served_on_loopback_only_and_a_browser_connects_to_the_run(live, tmp_path):
    process, found = live
    address, page_port, data_port = found[1], int(found[2]), int(found[3])
    ports = wait_for(lambda: {p for _, p in listening(process)} >= {page_port, data_port})
    assert ports, "page and data are served"
    assert {ip for ip, _ in listening(process)} == {"127.0.0.1"}
    if reason := why_no_browser():
        pytest.skip(reason)
    with drawn(address, tmp_path, "--window-size=600,400"):
        assert wait_for(lambda: connected(data_port)), "the page fetches the run's data"
        assert process.poll() is None, "and the run goes on"
