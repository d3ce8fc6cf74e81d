"""The pipeline: the other rooms wired together, with the threads, the shutdown and the files.

::

    live, replay   source ─▶ Session ─┬▶ Recorder                 session, read_queue, process
                                      ├▶ Decoding ─▶ Analyser     decoding
                                      └▶ refresh ─▶ listeners     refreshing (and a child)

    analyse        file ─▶ prefetch: decode ─▶ Analyser ─▶ Analysis    analyse_file, replaying
    Python         arrays ─▶ events ─────────▶ Analyser ─▶ Analysis    analyse_arrays, columns
                   port ───▶ open_stream ─▶ Block, Gap                 stream

    notebook ─ live ─▶ Session, in the background ──▶ newest Analysis  live_session

A function here is what a command of the same name calls: `run` (live and replays), `analyse_file`,
`check`, `import_export` with `exports`, `simulate`, `together`, `theory` (conversions, single
quantities, charts), `doctor`; `settings` are what the user asked for. `outputs` writes what a run
leaves behind, and opens its charts again; `event_hook` reports events to a program of the user.
`table_files` reads files of other programs, and `rerun_importer` lets the viewer open recordings.
Whichever way samples come, they pass the same decoder and the same sums, so that no two ways can
disagree.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.pipeline.analyse_arrays import (
        analyse,
    )
    from allanscope.pipeline.analyse_file import (
        analyse_input,
        full_settings,
        recorded_settings,
        require_rate,
    )
    from allanscope.pipeline.check import (
        Limits,
        check_against,
        check_failure,
        read_limits,
        to_json,
        to_junit,
    )
    from allanscope.pipeline.decoding import (
        Decoding,
    )
    from allanscope.pipeline.doctor import (
        machine_checks,
    )
    from allanscope.pipeline.import_export import (
        export_recording,
        import_capture,
    )
    from allanscope.pipeline.live_session import LiveSession, live
    from allanscope.pipeline.outputs import (
        open_charts,
        report_sessions,
        write_json,
        write_report,
        write_table,
    )
    from allanscope.pipeline.process import (
        reuse_memory,
        search_process,
        stopped_by_signals,
    )
    from allanscope.pipeline.replaying import joined
    from allanscope.pipeline.run import (
        run_live,
        run_replay,
    )
    from allanscope.pipeline.settings import (
        DeviceSettings,
        SessionSettings,
        SimulatedSettings,
    )
    from allanscope.pipeline.simulate import (
        run_emulated_device,
        run_virtual_device,
        simulate_recording,
    )
    from allanscope.pipeline.stream import (
        Stream,
        open_stream,
    )
    from allanscope.pipeline.table_files import is_table_file
    from allanscope.pipeline.theory import (
        StabilityRequest,
        convert_table,
        draw_chart,
        stability_table,
    )
    from allanscope.pipeline.together import Together, analyse_together

__all__ = [
    "Decoding",
    "DeviceSettings",
    "Limits",
    "LiveSession",
    "SessionSettings",
    "SimulatedSettings",
    "StabilityRequest",
    "Stream",
    "Together",
    "analyse",
    "analyse_input",
    "analyse_together",
    "check_against",
    "check_failure",
    "convert_table",
    "draw_chart",
    "export_recording",
    "full_settings",
    "import_capture",
    "is_table_file",
    "joined",
    "live",
    "machine_checks",
    "open_charts",
    "open_stream",
    "read_limits",
    "recorded_settings",
    "report_sessions",
    "require_rate",
    "reuse_memory",
    "run_emulated_device",
    "run_live",
    "run_replay",
    "run_virtual_device",
    "search_process",
    "simulate_recording",
    "stability_table",
    "stopped_by_signals",
    "to_json",
    "to_junit",
    "write_json",
    "write_report",
    "write_table",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "StabilityRequest": "theory",
        "convert_table": "theory",
        "stability_table": "theory",
        "draw_chart": "theory",
        "Decoding": "decoding",
        "LiveSession": "live_session",
        "live": "live_session",
        "DeviceSettings": "settings",
        "SessionSettings": "settings",
        "SimulatedSettings": "settings",
        "Stream": "stream",
        "analyse": "analyse_arrays",
        "Together": "together",
        "analyse_input": "analyse_file",
        "analyse_together": "together",
        "Limits": "check",
        "check_against": "check",
        "machine_checks": "doctor",
        "export_recording": "import_export",
        "check_failure": "check",
        "full_settings": "analyse_file",
        "import_capture": "import_export",
        "is_table_file": "table_files",
        "joined": "replaying",
        "open_charts": "outputs",
        "open_stream": "stream",
        "read_limits": "check",
        "recorded_settings": "analyse_file",
        "require_rate": "analyse_file",
        "report_sessions": "outputs",
        "run_emulated_device": "simulate",
        "run_live": "run",
        "run_replay": "run",
        "run_virtual_device": "simulate",
        "reuse_memory": "process",
        "search_process": "process",
        "simulate_recording": "simulate",
        "stopped_by_signals": "process",
        "to_json": "check",
        "to_junit": "check",
        "write_json": "outputs",
        "write_report": "outputs",
        "write_table": "outputs",
    },
)
