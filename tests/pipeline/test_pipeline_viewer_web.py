"""The web viewer of a live run: on loopback only, its address printed, and a browser connects."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "view"))

from browser import browser_command, why_no_browser

PAGE = re.compile(
    r"charts: (http://127\.0\.0\.1:(\d+)/\?url=rerun%2Bhttp%3A%2F%2F127\.0\.0\.1%3A(\d+)%2Fproxy\S*)"
)
GRAPHICS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


@pytest.fixture
def live(tmp_path):
    """Start a live run with the web viewer; return its process and what it said of the page."""
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-u", "-m", "allanscope", "live", "sim", "--view", "web"]
    process = subprocess.Popen(
        [*command, "--out", str(tmp_path / "session")],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=environment,
        text=True,
    )
    said = ""
    for line in process.stdout:
        said += line
        if found := PAGE.search(line):
            break
    else:
        pytest.fail(said)
    yield process, found
    process.send_signal(signal.SIGINT)
    process.stdout.close()
    try:
        process.wait(100)
    finally:
        process.kill()


def listening(process):
    """Return the addresses at which a process and its children listen."""
    family = [process.pid, *(child.pid for child in psutil.Process(process.pid).children(True))]
    return {
        (one.laddr.ip, one.laddr.port)
        for one in psutil.net_connections("tcp")
        if one.pid in family and one.status == psutil.CONN_LISTEN
    }


def connected(port):
    """Return the programs that are connected to a port of this machine."""
    return {
        psutil.Process(one.pid).name()
        for one in psutil.net_connections("tcp")
        if one.raddr and one.raddr.port == port and one.pid and one.status == "ESTABLISHED"
    }


def wait_for(condition, seconds=80.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := condition():
            return found
        time.sleep(0.3)
    return condition()


@pytest.mark.timeout(240)  # two viewers and a browser, on whatever machine
def test_the_page_is_served_on_loopback_only_and_a_browser_connects_to_the_run(live, tmp_path):
    process, found = live
    address, page_port, data_port = found[1], int(found[2]), int(found[3])
    ports = wait_for(lambda: {p for _, p in listening(process)} >= {page_port, data_port})
    assert ports, "page and data are served"
    assert {ip for ip, _ in listening(process)} == {"127.0.0.1"}
    if reason := why_no_browser():
        pytest.skip(reason)
    browser = subprocess.Popen(
        browser_command(
            tmp_path / "profile",
            *GRAPHICS,
            "--ignore-gpu-blocklist",
            "--window-size=600,400",
            "--remote-debugging-port=0",
            address,
        ),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "HOME": str(tmp_path)},
    )
    try:
        assert wait_for(lambda: connected(data_port)), "the page fetches the run's data"
        assert process.poll() is None, "and the run goes on"
    finally:
        browser.terminate()
        browser.wait(20)
