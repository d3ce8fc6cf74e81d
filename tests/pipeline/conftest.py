"""The command line as its user has it: a process, what it prints, and its exit code."""

import subprocess
import sys

import pytest

from allanscope.pipeline.outputs import ReportProcess


@pytest.fixture(scope="session")
def run():
    """Run the command line in a process of its own, check its exit code, return what it printed."""

    def run(*arguments, code=0):
        command = [sys.executable, "-m", "allanscope", *map(str, arguments)]
        ran = subprocess.run(command, capture_output=True, text=True, timeout=110, check=False)
        assert ran.returncode == code, ran.stderr
        return ran

    return run


@pytest.fixture
def undrawn(monkeypatch):
    """Leave the report of a session in this process undrawn: its pictures take seconds."""

    def begin(self, analysis):
        self._analysis, self._page = analysis, "<html>"

    monkeypatch.setattr(ReportProcess, "begin", begin)
