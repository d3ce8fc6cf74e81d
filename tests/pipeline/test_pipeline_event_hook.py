"""A command for each event, and a line on a pipe: without a shell, and nobody waits for them."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path

import pytest

from allanscope.errors import UsageError
from allanscope.pipeline.event_hook import MOST_WAITING, EventHook
from allanscope.pipeline.settings import SessionSettings
from allanscope.samples import Notice

EVENT = json.dumps({"news": "found", "kind": "step", "words": "$(touch hacked); `id`"})
TOLD = Notice("event", "level shift", {"host": 1, "news": "found", "event": EVENT})


def test_command_gets_the_event_on_its_input_and_no_shell_sees_it(tmp_path: Path):
    out = tmp_path / "out of it"
    program = "import sys; open(sys.argv[1], 'w').write(sys.stdin.read() + sys.argv[2])"
    hook = EventHook(f"""{sys.executable} -c "{program}" '{out}' '$HOME'""")
    hook.notice(Notice("text", "not an event"))
    hook.notice(TOLD)
    hook.close()
    assert out.read_text() == EVENT + "\n$HOME"


def test_line_on_a_pipe(tmp_path: Path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    failures: list[str] = []
    hook = EventHook(pipe=pipe, fail=failures.append)
    hook.notice(TOLD)  # nobody reads yet: said, and nobody waits
    while not failures:
        time.sleep(0.01)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    hook.notice(TOLD)
    hook.close()
    assert json.loads(os.read(reader, 1 << 16))["kind"] == "step"
    os.close(reader)


def test_nobody_waits_for_a_command_that_hangs(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("allanscope.pipeline.event_hook.PATIENCE_S", 0.1)
    failures: list[str] = []
    hook = EventHook(f'{sys.executable} -c "import time; time.sleep(600)"', fail=failures.append)
    told = threading.Thread(
        target=lambda: [hook.notice(TOLD) for _ in range(MOST_WAITING + 5)], daemon=True
    )
    told.start()
    told.join(10.0)
    assert not told.is_alive()
    assert "faster" in failures[0]
    hook.close()
    hook._thread.join(0.1)


@pytest.mark.parametrize("command", ["no-such-program-here x", "unclosed 'quote"])
def test_command_that_cannot_be_run_is_refused_before_anything_begins(command: str):
    with pytest.raises(UsageError, match="--on-event"):
        SessionSettings(on_event=command)
