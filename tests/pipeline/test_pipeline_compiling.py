"""The line that says that kernels are being compiled, and the thread that reads ahead."""

import subprocess
import sys

import pytest

from allanscope.errors import DeviceError
from allanscope.pipeline import live
from allanscope.pipeline.ahead import ahead
from allanscope.pipeline.compiling import COMPILING, load_kernels
from allanscope.pipeline.settings import DeviceSettings, SessionSettings, SimulatedSettings
from allanscope.spectrum import level

PROGRAM = """
import numba
from allanscope.pipeline.compiling import tell_when_compiling
tell_when_compiling(print)
from kernel import double
assert double(3) == 6 and double(3.0) == 6.0
"""

KERNEL = """
from numba import njit
@njit(cache=True)
def double(x):
    return 2 * x
"""


def test_it_is_said_once_when_something_is_compiled_and_never_again(tmp_path):
    (tmp_path / "kernel.py").write_text(KERNEL)
    said = []
    for _ in range(2):
        command = [sys.executable, "-c", PROGRAM]
        ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        said.append(ran.stdout.splitlines())
    assert said == [[COMPILING], []]


def test_all_that_takes_long_is_loaded_before_the_port_is_opened(monkeypatch):
    """A board does not wait: what its buffer cannot hold until it is read is lost."""
    done = []

    def opened(*_):
        done.append("port")
        raise DeviceError("there is none")

    monkeypatch.setattr(live, "load_kernels", lambda wire: done.append("kernels"))
    monkeypatch.setattr(live, "load_rerun", lambda: done.append("rerun"))
    monkeypatch.setattr(live, "device_source", opened)
    quiet = SessionSettings(quiet=True, view="none")
    with pytest.raises(DeviceError):
        live.run_live("nowhere", DeviceSettings(), quiet, SimulatedSettings())
    assert done == ["kernels", "rerun", "port"]


def test_the_samples_that_are_taken_first_make_a_spectrum(monkeypatch):
    """So that its kernel, too, is there before the port is opened."""
    made = []
    monkeypatch.setattr(level, "_add_squares", lambda spectra, power: made.append(spectra.shape))
    load_kernels("native")
    assert made


def test_a_port_that_is_not_there_is_told_before_anything_is_compiled(monkeypatch):
    monkeypatch.setattr(live, "load_kernels", lambda wire: pytest.fail("compiled in vain"))
    quiet = SessionSettings(quiet=True, view="none")
    with pytest.raises(DeviceError, match="no port /dev/nowhere"):
        live.run_live("/dev/nowhere", DeviceSettings(), quiet, SimulatedSettings())


def test_what_reads_ahead_gives_everything_in_order_and_errors_in_their_place():
    def items():
        yield from range(10)
        raise ValueError("torn")

    few = ahead(items(), depth=3)
    assert [next(few) for _ in range(10)] == list(range(10))
    with pytest.raises(ValueError, match="torn"):
        next(few)


def test_what_reads_ahead_stays_no_more_than_its_depth_ahead_and_ends_when_nobody_asks():
    made = []

    def items():
        for number in range(1000):
            made.append(number)
            yield number

    few = ahead(items(), depth=2)
    assert next(few) == 0
    few.close()
    assert len(made) <= 5
