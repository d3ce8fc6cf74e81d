"""A text stream on a port: its header is said once, perhaps before anybody listens."""

import json
import os
import subprocess
import sys
import threading
import time
import tty

import numpy as np
import pytest

from allanscope.__main__ import main

HEADER = b"gx[mdps],gy[mdps],gz[mdps],ax[mg],ay[mg],az[mg]\r\n"


@pytest.fixture
def lines():
    counts = np.random.default_rng(5).normal(0.0, 70.0, (400, 6)).round().astype(int)
    counts[:, 5] += 1000
    return [",".join(map(str, row)).encode() + b"\r\n" for row in counts]


def listened(tmp_path, first, lines):
    """Run ``live`` on a pty into which something was said before; return result and output."""
    device, host = os.openpty()
    tty.setraw(host)
    os.write(device, first)
    done = threading.Event()

    def speak():
        for line in lines * 20:
            if done.is_set():
                break
            os.write(device, line)
            time.sleep(0.01)

    speaker = threading.Thread(target=speak, daemon=True)
    speaker.start()
    try:
        command = [sys.executable, "-m", "allanscope", "live", os.ttyname(host), "--for", "2s",
                   "--rate", "104", "--view", "none", "--out", str(tmp_path / "out")]  # fmt: skip
        run = subprocess.run(command, check=False, capture_output=True, text=True, timeout=240)
        assert run.returncode == 0, run.stderr
    finally:
        done.set()
        speaker.join(30.0)
        os.close(device)
        os.close(host)
    return json.loads((tmp_path / "out" / "result.json").read_text()), run.stdout


def test_a_header_that_waits_in_the_port_is_believed(tmp_path, lines):
    result, _ = listened(tmp_path, HEADER, lines)
    assert result["assumptions"] == []
    N = result["axes"]["gx"]["coefficients"]["N"]
    assert N["value"] == pytest.approx(0.070 / np.sqrt(104.0), rel=0.4)


def test_a_unit_that_nobody_said_stands_at_the_top(tmp_path, lines, capsys):
    result, shown = listened(tmp_path, lines[0], lines)
    units = [text for text in result["assumptions"] if "unit of gyro" in text]
    assert len(units) == 1
    assert result["remarks"][: len(result["assumptions"])] == result["assumptions"]
    rows = shown.splitlines()
    title = max(i for i, row in enumerate(rows) if row.startswith("allanscope  ")) + 2
    told = [row for row in rows[title:] if row.strip()]  # verdict and coefficients come first
    assert any(row.startswith(f"Assumed: {units[0][:40]}") for row in told), shown
    assert main(["report", str(tmp_path / "out"), "--out", str(tmp_path / "r.html")]) == 0
    page = (tmp_path / "r.html").read_text()
    assert page.index(units[0][:40]) < page.index("<table")
