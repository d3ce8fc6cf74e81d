"""What a command loads: parts of numpy that nothing uses wait until they are used."""

import subprocess
import sys

SCRIPT = """
import sys
from allanscope.lazy import defer_unused
defer_unused()
import scipy.special
unused = ("numpy.f2py.f2py2e", "numpy.testing._private")
print([name in sys.modules for name in unused])
import numpy
import numpy.testing
numpy.testing.assert_allclose(1.0, 1.0)
print(numpy.f2py.__name__, callable(numpy.f2py.run_main))
"""


def test_scipy_does_not_load_what_nobody_uses_and_it_works_when_somebody_does() -> None:
    ran = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert ran.stderr == ""
    assert ran.stdout.splitlines() == ["[False, False]", "numpy.f2py True"]
