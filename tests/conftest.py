"""What holds for all tests."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest
from hypothesis import settings

# As the command has it, before numpy is imported: more threads take up to twice the processor time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

settings.register_profile("fixed", derandomize=True)
"""The same examples in every run: a failure is one of the change that is tested.

`python -m pytest --hypothesis-profile default` looks at others.
"""
settings.load_profile("fixed")


@pytest.fixture(scope="session", autouse=True)
def ending_signals() -> Iterator[None]:
    """Let processes hear the signals that a shell, or nohup, keeps from what runs on its own."""
    before = {
        signal.SIGINT: signal.signal(signal.SIGINT, signal.default_int_handler),
        signal.SIGHUP: signal.signal(signal.SIGHUP, signal.SIG_DFL),
    }
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
