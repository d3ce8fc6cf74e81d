"""A saved bank goes on as if nothing had happened, and nothing else passes for one."""

import json
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from allanscope.allan import AllanBank


def samples(n, seed=0):
    return np.random.default_rng(seed).integers(-99, 99, (n, 2)).astype(np.int16)


def bank_of(*segments):
    bank = AllanBank(100.0, axes=2, per_octave=2, scale=[0.5, 2.0])
    for i, segment in enumerate(segments):
        if i:
            bank.gap()
        bank.update(segment)
    return bank


@settings(max_examples=25, deadline=None)
@given(first=st.integers(0, 20_000), second=st.integers(0, 2000), gap=st.booleans())
def test_a_restored_bank_goes_on_to_the_same_bits(assert_identical, first, second, gap):
    bank = bank_of(samples(50), samples(first, 1))
    restored = AllanBank.from_state(bank.state())
    for each in (bank, restored):
        if gap:
            each.gap()
        each.update(samples(second, 2))
    assert_identical(bank, restored)
    for kind in ("oadev", "stdev", "theoh"):
        np.testing.assert_array_equal(
            bank.deviation(kind).deviation, restored.deviation(kind).deviation
        )


def test_a_state_travels_to_another_process_as_a_plain_npz(assert_identical, tmp_path):
    bank = bank_of(samples(3000))
    np.savez(tmp_path / "bank.npz", **bank.state())
    script = (
        "import sys, numpy as np; from allanscope.allan.bank import AllanBank\n"
        "with np.load(sys.argv[1], allow_pickle=False) as state:\n"
        "    bank = AllanBank.from_state(state)\n"
        "bank.update(np.arange(100, dtype=np.int16).reshape(50, 2))\n"
        "np.savez(sys.argv[2], **bank.state())\n"
    )
    subprocess.run(
        [sys.executable, "-c", script, tmp_path / "bank.npz", tmp_path / "next.npz"], check=True
    )
    bank.update(np.arange(100, dtype=np.int16).reshape(50, 2))
    with np.load(tmp_path / "next.npz") as state:
        assert_identical(bank, AllanBank.from_state(state))


def test_a_state_is_a_copy(assert_identical):
    bank = bank_of(samples(300))
    state = bank.state()
    bank.update(samples(300))
    restored = AllanBank.from_state(state)
    restored.update(samples(300))
    assert_identical(bank, restored)
    assert AllanBank.from_state(state).samples == 300


@pytest.mark.parametrize("name", bank_of(samples(1)).state())
def test_a_damaged_state_is_refused(name):
    state = bank_of(samples(600), samples(100)).state()
    missing = {key: array for key, array in state.items() if key != name}
    with pytest.raises(ValueError, match="state of a bank"):
        AllanBank.from_state(missing)
    flipped = state | {name: state[name].copy()}
    flipped[name].reshape(-1).view(np.uint8)[0] ^= 16
    with pytest.raises(ValueError, match="state"):
        AllanBank.from_state(flipped)
    with pytest.raises(ValueError, match="state"):
        AllanBank.from_state(state | {name: state[name].reshape(-1)[:0]})


@pytest.mark.parametrize(
    "foreign",
    [
        {},
        {"header": np.zeros(0, np.uint8)},
        {"header": np.frombuffer(b"[1, 2]", np.uint8)},
        {"header": np.frombuffer(b'{"format": "something", "version": 1, "arrays": {}}', np.uint8)},
        {"header": np.frombuffer(b"\xff\xfe", np.uint8)},
        {"header": "text"},
        {"header": np.frombuffer(b"[" * 100_000, np.uint8)},
    ],
)
def test_what_is_no_state_is_refused(foreign):
    with pytest.raises(ValueError, match="state"):
        AllanBank.from_state(foreign)


def test_a_later_version_is_refused_by_name():
    state = bank_of(samples(10)).state()
    header = json.loads(state["header"].tobytes())
    header["version"] = 3
    state["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with pytest.raises(ValueError, match="version 3"):
        AllanBank.from_state(state)


def forged(**changes):
    """Return a state with consistent checksums and numbers that do not fit together."""
    from allanscope.allan.bank import pack_state

    state = bank_of(samples(600), samples(100)).state()
    del state["header"]
    return pack_state(state | {name: np.array(value) for name, value in changes.items()})


@pytest.mark.parametrize(
    "changes",
    [
        {"rate": -1.0},
        {"per_octave": 0},
        {"per_octave": 3},
        {"cascade": [700, -1]},
        {"cascade": [10, 700]},
        {"cascade": [1 << 40, 1 << 40]},
        {"rungs": np.zeros((2, 1, 3, 512))},
        {"rungs": np.zeros((2, 70, 3, 512))},
        {"sums": np.zeros((2, 5, 11))},
        {"archive": [3, 700, 0]},
        {"archive": [1, 9000, 0]},
        {"archive": [2, 700, 2]},
        {"archive": [1, 700, -1]},
        {"starts": [5, 600]},
        {"starts": [0, 600, 600]},
        {"starts": [0, 701]},
        {"starts": np.zeros(0, np.int64)},
        {"rows": np.zeros((2, 2, 16))},
        {"part": np.zeros((2, 3))},
        {"scale": np.ones(3)},
        {"anchor": np.zeros(1)},
    ],
)
def test_numbers_that_would_lead_out_of_an_array_are_refused(changes):
    with pytest.raises(ValueError, match=r"state|rate|per_octave"):
        AllanBank.from_state(forged(**changes))
