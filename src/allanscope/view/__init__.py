"""Shows a session while it runs: charts in the Rerun viewer, numbers in the terminal.

Both are listeners of the pipeline: they receive what happens and never answer, never block, and
whatever becomes of them, the measurement goes on::

                     ┌ TerminalView   one screen, or a line a minute when piped
    info  samples ───┤
    gap   notice     └ RerunView      worker ─▶ loopback server ─▶ viewer (a process of its own)
    snapshot                                 └▶ session.rrd

The viewer has no logarithmic axes, so charts are drawn by hand, in three steps that know nothing
of each other: `chart` places values on a rectangle, `chart_content` says what is drawn there,
`rerun_drawing` puts it into the recording. `chart_builder` decides which entity shows what,
`rerun_blueprint` which tab shows which entity. Only files named
``rerun_*`` import Rerun, and none of them before it is needed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.view.progress_bar import is_notebook, progress
    from allanscope.view.rerun_recording import Canvas
    from allanscope.view.rerun_view import RerunView, load_rerun, require_rerun
    from allanscope.view.terminal import TerminalView, summary_lines
    from allanscope.view.viewer_process import ViewerProcess, has_display

__all__ = [
    "Canvas",
    "RerunView",
    "TerminalView",
    "ViewerProcess",
    "has_display",
    "is_notebook",
    "load_rerun",
    "progress",
    "require_rerun",
    "summary_lines",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "Canvas": "rerun_recording",
        "RerunView": "rerun_view",
        "TerminalView": "terminal",
        "ViewerProcess": "viewer_process",
        "has_display": "viewer_process",
        "load_rerun": "rerun_view",
        "require_rerun": "rerun_view",
        "is_notebook": "progress_bar",
        "progress": "progress_bar",
        "summary_lines": "terminal",
    },
)
