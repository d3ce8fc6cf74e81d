"""Take a picture of every tab of the viewer, from a made-up session: docs/images/view-*.png.

Run it from anywhere: ``python docs/screenshots.py``. It needs a Vulkan driver; a software one
(mesa-vulkan-drivers) will do.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests" / "view"))
os.environ.setdefault("RUST_LOG", "off")

import rerun as rr  # noqa: E402
from demo_analysis import ESTIMATORS  # noqa: E402
from demo_session import perform  # noqa: E402
from headless_viewer import HeadlessViewer, why_no_viewer  # noqa: E402
from PIL import Image  # noqa: E402
from rerun.chunk import RrdReader  # noqa: E402

from allanscope.samples import AXES  # noqa: E402
from allanscope.view.rerun_blueprint import TABS, layout  # noqa: E402
from allanscope.view.rerun_stream import APPLICATION  # noqa: E402
from allanscope.view.rerun_view import RerunView  # noqa: E402

NAMES = (
    "allan",
    "axis",
    "estimators",
    "spectra",
    "loop",
    "series",
    "temperature",
    "link",
    "findings",
    "tables",
)


def main() -> int:
    """Make the pictures that are asked for, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=NAMES, help=" ".join(NAMES))
    parser.add_argument("--out", type=Path, default=HERE / "images")
    parser.add_argument("--size", default="1440x860")
    parser.add_argument("--seconds", type=float, default=7300.0)
    options = parser.parse_args()
    if reason := why_no_viewer():
        print(reason)
        return 1
    options.out.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        session = _recorded(Path(folder), options.seconds)
        for name in options.names:
            tab = NAMES.index(name)
            path = options.out / f"view-{name}.png"
            _picture(session, tab, path, options.size)
            print(f"{TABS[tab]:22} {path.name}  {path.stat().st_size / 1e3:.0f} kB")
    return 0


def _recorded(folder: Path, seconds: float) -> Path:
    """Record a session and return its file."""
    view = RerunView(folder, "none", {"name": "demo", "started_unix_s": 1.79e9})
    view.start()
    perform(view, seconds)
    view.close()
    return folder / "session.rrd"


def _picture(session: Path, tab: int, path: Path, size: str) -> None:
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
        Image.fromarray(viewer.picture()).quantize(128).save(path, optimize=True)


if __name__ == "__main__":
    sys.exit(main())
