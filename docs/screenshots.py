"""Take the pictures of the documentation: every tab of the viewer, and the report.

The viewer shows a made-up session, and of the Allan deviation over time a simulated night with
eight events; the report shows the analysis of a simulated hour. Run it from
anywhere: ``python docs/screenshots.py``, or with the names of the pictures that are wanted. It
needs a Vulkan driver, of which a software one (mesa-vulkan-drivers) will do, and Chromium.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests"))
os.environ.setdefault("RUST_LOG", "off")

import rerun as rr  # noqa: E402
from PIL import Image  # noqa: E402
from rerun.chunk import RrdReader  # noqa: E402

from allanscope.samples import AXES  # noqa: E402
from allanscope.view.rerun_blueprint import TABS, layout  # noqa: E402
from allanscope.view.rerun_recording import APPLICATION  # noqa: E402
from allanscope.view.rerun_view import RerunView  # noqa: E402
from support.browser import picture_of, why_no_browser  # noqa: E402
from support.demo_analysis import ESTIMATORS  # noqa: E402
from support.demo_session import perform  # noqa: E402
from support.headless_viewer import HeadlessViewer, why_no_viewer  # noqa: E402

VIEWS = (
    "allan",
    "axis",
    "together",
    "estimators",
    "spectra",
    "loop",
    "series",
    "dynamic",
    "temperature",
    "link",
    "findings",
    "tables",
)
"""Pictures of the viewer, one a tab, in the order of the tabs."""

REPORTS = {"report": False, "report-dark": True}
"""Pictures of the report, and whether they are dark."""

EFFECTS = ("sinusoid:frequency=12.5,amplitude=0.012", "step:time=2000,size=0.01,axis=gy")
REPORT_SIZE = "1100,2300"


def main() -> int:
    """Make the pictures that are asked for, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=(*VIEWS, *REPORTS), help="of the pictures")
    parser.add_argument("--out", type=Path, default=HERE / "images")
    parser.add_argument("--size", default="1440x860", help="of the viewer")
    parser.add_argument("--seconds", type=float, default=7300.0, help="length of the session")
    options = parser.parse_args()
    views = [name for name in options.names if name in VIEWS]
    reports = [name for name in options.names if name in REPORTS]
    if reason := (views and why_no_viewer()) or (reports and why_no_browser()):
        print(reason)
        return 1
    options.out.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        if views:
            session = _recorded(Path(folder), options.seconds)
            for name in views:
                shown = _night(Path(folder)) if name == "dynamic" else session
                _view(shown, VIEWS.index(name), options.out / f"view-{name}.png", options.size)
        if reports:
            page = _report(Path(folder))
            for name in reports:
                picture = picture_of(page, Path(folder), REPORT_SIZE, dark=REPORTS[name])
                _save(Image.fromarray(picture), options.out / f"{name}.png")
    return 0


def _recorded(folder: Path, seconds: float) -> Path:
    """Record a session and return its file."""
    view = RerunView(folder, "none", {"name": "demo", "started_unix_s": 1.79e9})
    view.start()
    perform(view, seconds)
    view.close()
    return folder / "session.rrd"


def _night(folder: Path) -> Path:
    """Replay the night with eight events of `benchmarks/events.py` and return its file."""
    sys.path.insert(0, str(HERE.parent / "benchmarks"))
    from events import record_night

    from allanscope.pipeline import DeviceSettings, SessionSettings, run_replay

    recording, session = folder / "night.mcap", folder / "night"
    record_night(recording, 6000.0, seed=1)
    settings = SessionSettings(out=session, view="none", quiet=True)
    run_replay(recording, float("inf"), DeviceSettings(), settings)
    return session / "session.rrd"


def _view(session: Path, tab: int, path: Path, size: str) -> None:
    """Copy the session with a layout that opens on this tab, and look at it."""
    turned = session.with_name(f"tab-{tab}.rrd")
    recording = rr.RecordingStream(APPLICATION)
    recording.save(turned, default_blueprint=layout(AXES, ESTIMATORS, tab))
    recording.send_chunks(RrdReader(session).stream())
    recording.flush()
    recording.disconnect()
    with HeadlessViewer(str(turned), size) as viewer:
        for shown in viewer.wait().views:
            for report in shown.reports:
                print(f"  {shown.name}: {report}")
        _save(Image.fromarray(viewer.picture()), path, f"tab {TABS[tab]}")


def _report(folder: Path) -> Path:
    """Analyse a simulated hour and return the page."""
    from allanscope.pipeline.analyse_file import analyse_input
    from allanscope.pipeline.outputs import write_report
    from allanscope.pipeline.settings import DeviceSettings, SimulatedSettings
    from allanscope.pipeline.simulate import simulate_recording

    recording, page = folder / "bench.mcap", folder / "report.html"
    device = DeviceSettings(rate_hz=104.0)
    simulate_recording(recording, 1.0, device, SimulatedSettings(7, EFFECTS), quiet=True)
    write_report(analyse_input(recording, DeviceSettings(), quiet=True), page)
    return page


def _save(picture: Image.Image, path: Path, what: str = "") -> None:
    # Coverage before frequency: a thin curve keeps its colour.
    picture.quantize(128, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)
    print(f"{path.name:22} {path.stat().st_size / 1e3:4.0f} kB  {what}")


if __name__ == "__main__":
    sys.exit(main())
