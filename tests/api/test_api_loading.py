"""What a command loads: parts of numpy and SciPy that nothing uses wait until they are used."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import pytest

from allanscope import lazy

SCRIPT = """
import sys
from allanscope.lazy import defer_unused
defer_unused()
from scipy.optimize._nnls import nnls
unused = ("numpy.f2py.f2py2e", "numpy.ma.core", "numpy.testing._private", "scipy.sparse._base",
          "scipy.optimize._minimize", "scipy.spatial._qhull")
print([name in sys.modules for name in unused])
import numpy
import numpy.testing
numpy.testing.assert_allclose(1.0, 1.0)
print(numpy.f2py.__name__, callable(numpy.f2py.run_main))
bounds = [(-1.0, 1.0)] * 2
from allanscope.optimise import minimise, root_between
print(minimise(lambda x: (x @ x), numpy.ones(1)).converged, root_between(float, -1.0, 1.0))
print([name in sys.modules for name in ("scipy.spatial._qhull", "scipy.optimize._shgo")])
import scipy.optimize
print(numpy.ma.is_masked(bounds), scipy.optimize.nnls is nnls)
print(scipy.optimize.shgo(lambda x: x @ x, bounds, sampling_method="sobol").success)
"""


def test_scipy_does_not_load_what_nobody_uses_and_it_works_when_somebody_does() -> None:
    ran = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert ran.stderr == ""
    deferred, numpys, found, rest, *scipys = ran.stdout.splitlines()
    assert (deferred, numpys) == (str([False] * 6), "numpy.f2py True")
    assert (found, rest, scipys) == ("True 0.0", str([False] * 2), ["False True", "True"])


def test_a_module_of_a_package_is_loaded_before_the_package() -> None:
    modules = ("scipy.spatial.distance", "scipy.optimize._minimize", "numpy.ma.core", "scipy.stats")
    for module in modules:
        script = f"from allanscope.lazy import defer_unused\ndefer_unused()\nimport {module}"
        subprocess.run([sys.executable, "-c", script], check=True)


def test_two_threads_that_ask_for_a_deferred_module_at_once_both_see_it_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "import time\nfirst = 1\ntime.sleep(0.2)\nlast = 2\n"
    tmp_path.joinpath("loads_slowly.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(lazy, "_UNUSED", frozenset({"loads_slowly"}))
    monkeypatch.setattr(sys, "meta_path", [lazy._Finder(), *sys.meta_path])
    module = import_module("loads_slowly")
    assert "first" not in vars(module)
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(lambda _: module.last, range(2))) == [2, 2]
    with pytest.raises(AttributeError, match="no attribute 'missing'"):
        _ = module.missing


THREADS = """
import os, sys
from contextlib import suppress
from allanscope.__main__ import main
loaded = "numpy" in sys.modules
with suppress(SystemExit):
    main(["convert", "nothing"])
import numpy
numpy.ones((500, 500)) @ numpy.ones((500, 500))
print(loaded, len(os.listdir("/proc/self/task")))
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/task"), reason="threads are read from /proc")
def test_a_command_starts_no_threads_of_blas_which_would_wait_for_each_other() -> None:
    clean = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name}
    ran = subprocess.run(
        [sys.executable, "-c", THREADS], capture_output=True, text=True, check=True, env=clean
    )
    assert ran.stdout.splitlines()[-1] == "False 1"
