"""The line that says that kernels are being compiled, and the thread that reads ahead."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import allanscope
from allanscope.errors import DeviceError
from allanscope.pipeline import DeviceSettings, SessionSettings, SimulatedSettings, live
from allanscope.pipeline.process import COMPILING, load_kernels
from allanscope.pipeline.replaying import prefetch
from allanscope.spectrum import ladder

PROGRAM = """
import numba
from allanscope.pipeline.process import tell_when_compiling
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
    monkeypatch.setattr(ladder, "_add_squares", lambda spectra, power: made.append(spectra.shape))
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

    few = prefetch(items(), depth=3)
    assert [next(few) for _ in range(10)] == list(range(10))
    with pytest.raises(ValueError, match="torn"):
        next(few)


def test_what_reads_ahead_stays_no_more_than_its_depth_ahead_and_ends_when_nobody_asks():
    made = []

    def items():
        for number in range(1000):
            made.append(number)
            yield number

    few = prefetch(items(), depth=2)
    assert next(few) == 0
    few.close()
    assert len(made) <= 5


DEVIATION = """
import allanscope, numpy
print(allanscope.deviation(numpy.arange(64.0), 1.0, "oadev").deviation[0])
"""


def _without_a_place(tmp_path):
    """Return an environment in which numba can write neither beside the package nor at home.

    Files stand where the folders would have to be, which stops the superuser as well.
    """
    package = tmp_path / "site" / "allanscope"
    shutil.copytree(
        Path(allanscope.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__")
    )
    for folder in [package, *(path for path in package.rglob("*") if path.is_dir())]:
        (folder / "__pycache__").touch()
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    unset = ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "PYTHONPATH")
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    home = {"HOME": os.devnull, "TMPDIR": str(temporary), "PYTHONPATH": str(package.parent)}
    return environment | home, temporary


def test_without_a_writable_package_or_home_compiled_code_is_kept_in_a_temporary_folder(tmp_path):
    environment, temporary = _without_a_place(tmp_path)
    command, said, compiled = [sys.executable, "-c", DEVIATION], [], []
    for _ in range(2):
        ran = subprocess.run(
            command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert ran.returncode == 0, ran.stderr
        assert float(ran.stdout) == pytest.approx(0.5**0.5)
        (line,) = ran.stderr.splitlines()
        assert line.startswith("allanscope: compiled code is kept in ")
        said.append(line)
        compiled.append({file: file.stat().st_mtime_ns for file in temporary.rglob("*.nbc")})
    (folder,) = temporary.iterdir()
    assert str(folder) in said[0]
    assert compiled[0], "what was compiled lies there"
    assert compiled[0] == compiled[1], "and is found by the second start"
    if os.name == "posix":
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.mark.skipif(os.name != "posix", reason="other systems have a temporary folder per user")
def test_a_folder_that_others_may_write_to_is_not_trusted_with_code(tmp_path):
    environment, temporary = _without_a_place(tmp_path)
    planted = temporary / f"allanscope-compiled-{os.getuid()}"
    planted.mkdir()
    planted.chmod(0o777)
    ran = subprocess.run(
        [sys.executable, "-c", DEVIATION],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    assert not list(planted.iterdir())
