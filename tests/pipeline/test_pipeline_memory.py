"""What a run lets go of: free memory and library pages, and nothing that was ever changed."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from allanscope.analysis import Analyser
from allanscope.pipeline import refreshing
from allanscope.pipeline.process import _unchanged_libraries

SMAPS = """\
00400000-00500000 r-xp 00000000 fe:00 1    /usr/bin/python3
Rss:                1024 kB
Anonymous:             0 kB
7f0000000000-7f0000200000 r-xp 00000000 fe:00 2    /usr/lib/libLLVM.so
Rss:                1024 kB
Anonymous:             0 kB
7f0000200000-7f0000300000 r--p 00200000 fe:00 2    /usr/lib/libLLVM.so
Rss:                1024 kB
Anonymous:            64 kB
7f0000300000-7f0000400000 rw-p 00300000 fe:00 2    /usr/lib/libLLVM.so
Rss:                1024 kB
Anonymous:             0 kB
7f0000400000-7f0000500000 rw-p 00000000 00:00 0
Rss:                1024 kB
Anonymous:             0 kB
7f0000500000-7f0000600000 r--p 00000000 fe:00 3    /usr/lib/a name with spaces.so.1
Rss:                1024 kB
Anonymous:             0 kB
"""

PROGRAM = """
import numpy as np
import scipy.linalg
from allanscope.pipeline.process import configure_malloc, trim_memory

def resident(which):
    text = open("/proc/self/status").read()
    return int(text.partition(f"{which}:")[2].split()[0])

configure_malloc()
data = np.random.default_rng(1).standard_normal((64, 64))
before, known = resident("RssFile"), scipy.linalg.inv(data)
trim_memory()
after = resident("RssFile")
assert after < before / 2, (before, after)
assert np.array_equal(scipy.linalg.inv(data), known)
large = np.ones(20 << 17)
del large  # from here on the C library would take blocks of this size from its heap
heap = resident("RssAnon")
blocks = [np.ones(1 << 17) for _ in range(40)]
kept = blocks[1::2]
del blocks
assert resident("RssAnon") - heap < 26 << 10, "each of a megabyte that was freed is given back"
"""


REUSED = """
import resource
import numpy as np
from allanscope.pipeline.process import configure_malloc, reuse_memory

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(100):
        np.ones(1 << 17)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

configure_malloc()
given_back = faults()
reuse_memory()
reused = faults()
assert given_back > 20_000 and reused < given_back / 20, (given_back, reused)
"""

TRANSFORMS = """
import numpy as np
from scipy.fft import dct, prev_fast_len, rfft
from allanscope.pipeline.process import configure_malloc, forget_transforms

def resident():
    return int(open("/proc/self/status").read().partition("RssAnon:")[2].split()[0])

configure_malloc()
record = np.random.default_rng(1).standard_normal(1 << 18)
dct(record[: 1 << 12])
before = resident()
for end in range(len(record), len(record) - 48_000, -4_000):
    length = prev_fast_len(end, real=True)
    known = dct(record[:length])
    rfft(record[:length])
kept = resident() - before
forget_transforms()
left = resident() - before
assert kept > 40 << 10 and left < 8 << 10, (kept, left)
assert np.array_equal(dct(record[:length]), known)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux shows it")
def test_the_tables_of_transforms_of_a_growing_record_are_let_go() -> None:
    subprocess.run([sys.executable, "-c", TRANSFORMS], check=True)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux is told")
def test_the_result_at_the_end_takes_the_memory_it_has_freed() -> None:
    subprocess.run([sys.executable, "-c", REUSED], check=True)


def test_only_libraries_of_which_no_page_was_changed_are_let_go(tmp_path: Path) -> None:
    (tmp_path / "smaps").write_text(SMAPS)
    (tmp_path / "maps").write_text("".join(_mappings(SMAPS)))
    assert list(_unchanged_libraries(tmp_path)) == [(0x7F0000000000, 0x200000)]


def test_a_library_that_is_just_being_loaded_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "smaps").write_text(SMAPS)
    (tmp_path / "maps").write_text("".join(_mappings(SMAPS)).replace("200000 r-xp", "600000 r-xp"))
    assert list(_unchanged_libraries(tmp_path)) == []


def _mappings(smaps: str) -> list[str]:
    return [line for line in smaps.splitlines(keepends=True) if not line.endswith("kB\n")]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux is told")
def test_memory_goes_down_and_the_libraries_go_on_working() -> None:
    subprocess.run([sys.executable, "-c", PROGRAM], check=True)


@pytest.mark.parametrize(
    ("pause_s", "results"), [(60.0, [1, 2, 4, 8]), (0.0, [1, 2, 3, 4, 5, 6, 7, 8, 9])]
)
def test_of_results_in_quick_succession_ever_fewer_are_followed_by_it(
    pause_s: float, results: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[float] = []
    done: list[int] = []
    waited_s: list[float] = []

    def trim() -> None:
        done.append(len(shown))
        waited_s.append(time.monotonic() - shown[-1])

    monkeypatch.setattr(refreshing, "REFRESH_S", 0.1)
    monkeypatch.setattr(refreshing, "DRAWN_S", 0.02)
    monkeypatch.setattr(refreshing, "TRIM_S", pause_s)
    monkeypatch.setattr(refreshing, "trim_memory", trim)
    refresher = refreshing.Refresher(
        lambda _: shown.append(time.monotonic()), refreshing.RefreshPolicy(1.0, 0.1)
    )
    until_s = time.monotonic() + 20.0
    while (len(shown) < 9 or len(done) < len(results)) and time.monotonic() < until_s:
        refresher.offer(Analyser()) if len(shown) < 9 else time.sleep(0.001)
    refresher.close()
    assert done == results
    assert min(waited_s) >= 0.02, "the result is being drawn meanwhile"
