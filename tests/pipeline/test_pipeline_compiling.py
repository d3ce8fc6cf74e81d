"""The line that says that kernels are being compiled, and the thread that reads ahead."""

import subprocess
import sys

import pytest

from allanscope.pipeline.ahead import ahead
from allanscope.pipeline.compiling import COMPILING

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
