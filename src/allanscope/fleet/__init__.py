"""Fleets: hundreds of boards in a chamber, thousands of nights on a share, one result.

::

    patterns ─▶ inputs ─▶ run ──task──▶ worker: worker_tasks.analyse_recording ──▶ outcome
                           │            (one process, one thread)        │
                           │◀────────────────────────────────────────────┘
                           ▼
                 store    OUT/results, OUT/index.jsonl: what is done is not done again
                           ▼
                 lot      OUT/lot.parquet (a row for each recording and axis), OUT/lot.html

The engine is Dask's, from the optional extra ``fleet``: a cluster on this machine
(`cluster`), or a scheduler that is there already. A task is one recording, read where it lies with
fsspec, through the same decoder, sums and closed loop as a single run. Only whoever started the
fleet writes; workers need to read the recordings, and this version of allanscope.

One recording that is large while workers are idle is split in time: see `split`.

The report asks what no single run can answer: how much of the spread is between boards and how
much between repeats of one, which boards do not belong, which effects are the rack's and not the
board's, which are there again in another night of the same board, and what changes with date and
temperature.

======================================= ============================================================
``inputs`` ``run`` ``work_queue``       recordings found, handed out and taken back
``cluster`` ``store`` ``outcome``       who does the work, and what is kept of each recording
``worker_tasks``                        on a worker: one recording
``split`` ``part_sums``                 on several workers: one large recording, in parts
``lot`` ``lot_files``                   the table of all recordings, and all files of a lot
``repeats`` ``typical_value``           runs of one unit; the value typical of all units
``outliers`` ``effects`` ``drift``      units that do not belong; effects; date and temperature
``acceptance`` ``comparison``           a lot against limits, and against another lot
``verdict``                             what is said first, and which units are named
``page`` ``unit_pages`` ``pictures``    the report
======================================= ============================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.fleet.run import FleetSettings, run_fleet
    from allanscope.fleet.work_queue import FleetResult, problem_lines, summary_lines

__all__ = ["FleetResult", "FleetSettings", "problem_lines", "run_fleet", "summary_lines"]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "FleetResult": "work_queue",
        "FleetSettings": "run",
        "problem_lines": "work_queue",
        "run_fleet": "run",
        "summary_lines": "work_queue",
    },
)
