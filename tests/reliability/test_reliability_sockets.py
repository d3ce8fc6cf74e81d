"""The table of listening sockets is what the system says."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from support.serving import listening, serving, wait_for

ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "src" / "allanscope"
OPENS = re.compile(
    r"create_server\(|\.listen\(|GrpcServerSink\(|HTTPServer\(|LocalCluster\(|--serve-web"
)


def table() -> dict[str, int]:
    """Return how many sockets each command has, by its words in the docs."""
    text = (ROOT / "docs" / "reliability.md").read_text("utf-8")
    section = text.partition("## Listening sockets")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (.+?) \| (\d+)", section, re.MULTILINE)
    return {
        words: int(count)
        for cell, count in rows
        for words in re.findall(r"`([^`]+)`", cell) or [cell]
    }


def agrees(process: subprocess.Popen[str], sockets: int) -> None:
    assert wait_for(lambda: len(listening(process)) >= sockets)
    found = listening(process)
    assert {ip for ip, _ in found} == {"127.0.0.1"}
    assert len(found) == sockets


def test_the_web_viewer_listens_as_the_table_says(tmp_path: Path) -> None:
    folder = tmp_path / "S"
    with serving("live", "sim", "--view", "web", "--out", folder, seconds=100.0) as (process, _):
        agrees(process, table()["live --view web"])
    with serving("open", folder, "--view", "web", seconds=100.0) as (process, _):
        agrees(process, table()["open --view web"])


def test_without_a_viewer_nothing_listens(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "allanscope", "live", "sim", "--rate", "104", "--view", "none"]
    out = ["--for", "2s", "--out", str(tmp_path / "S")]
    seen: set[tuple[str, int]] = set()
    with subprocess.Popen([*command, *out], stdout=subprocess.DEVNULL, text=True) as process:

        def has_ended() -> bool:
            if process.poll() is None:
                seen.update(listening(process))
            return process.poll() is not None

        assert wait_for(has_ended, 200.0)
    assert len(seen) == table()["live --view none"] == table()["all others"] == 0


def test_a_fleet_listens_as_the_table_says() -> None:
    script = (
        "from allanscope.fleet.cluster import local_cluster\n"
        "if __name__ == '__main__':\n"
        "    with local_cluster(1): print('up', flush=True); input()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        agrees(process, table()["fleet"] + 3)
        process.communicate("\n", timeout=100)


def test_no_other_place_in_the_sources_opens_a_listening_socket() -> None:
    places = {
        path.relative_to(SOURCES).as_posix()
        for path in SOURCES.rglob("*.py")
        if OPENS.search(path.read_text("utf-8"))
    }
    assert places == {
        "fleet/cluster.py",
        "simulator/virtual_port.py",
        "view/rerun_recording.py",
        "view/viewer_page.py",
        "view/viewer_process.py",
    }
