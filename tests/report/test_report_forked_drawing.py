"""Pictures that two processes draw: each once, in order, and none lost with one of them."""

import os
import time

import pytest

from allanscope.report.forked_drawing import draw_forked

if not hasattr(os, "fork"):
    pytest.skip("no fork on this system", allow_module_level=True)


def test_two_processes_share_the_pictures_and_their_order_stays():
    def drawn():
        time.sleep(0.05)
        return str(os.getpid())

    found = draw_forked({f"p{k}": drawn for k in range(12)})
    assert list(found) == [f"p{k}" for k in range(12)]
    assert len(set(found.values())) == 2
    assert str(os.getpid()) in found.values()


def test_what_the_other_process_leaves_undone_is_drawn_here():
    here = os.getpid()

    def drawn():
        time.sleep(0.05)
        if os.getpid() != here:
            os._exit(1)
        return "here"

    assert draw_forked({f"p{k}": drawn for k in range(4)}) == dict.fromkeys(
        ["p0", "p1", "p2", "p3"], "here"
    )


def test_an_error_is_raised_here_whoever_draws():
    here = os.getpid()

    def fails_there():
        time.sleep(0.05)
        if os.getpid() != here:
            raise ValueError("cannot be drawn there")
        return "drawn"

    def fails():
        raise ValueError("cannot be drawn")

    assert set(draw_forked(dict.fromkeys("abcd", fails_there)).values()) == {"drawn"}
    with pytest.raises(ValueError, match="cannot be drawn"):
        draw_forked(dict.fromkeys("abcd", fails))
