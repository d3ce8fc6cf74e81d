"""What a command loads: parts of numpy and SciPy that nothing uses wait until they are used."""

import os
import subprocess
import sys

import pytest

SCRIPT = """
import sys
from allanscope.lazy import defer_unused
defer_unused()
import scipy.optimize
unused = ("numpy.f2py.f2py2e", "numpy.testing._private", "scipy.spatial._qhull")
print([name in sys.modules for name in unused])
import numpy
import numpy.testing
numpy.testing.assert_allclose(1.0, 1.0)
print(numpy.f2py.__name__, callable(numpy.f2py.run_main))
bounds = [(-1.0, 1.0)] * 2
print(scipy.optimize.shgo(lambda x: x @ x, bounds, sampling_method="sobol").success)
"""


def test_scipy_does_not_load_what_nobody_uses_and_it_works_when_somebody_does() -> None:
    ran = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert ran.stderr == ""
    assert ran.stdout.splitlines() == ["[False, False, False]", "numpy.f2py True", "True"]


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
