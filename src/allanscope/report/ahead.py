"""Importing it does what of a report does not depend on a result: see `draw_ahead`.

For the process that draws one (`allanscope.worker_process`), which imports modules before it is
asked for anything.
"""

from __future__ import annotations

from allanscope.report.page import draw_ahead

draw_ahead()
