"""All pictures of a result by name, for the page and for files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from allanscope.analysis import Analysis, AxisAnalysis, searched
from allanscope.report.curve_pictures import deviation_picture, residual_picture
from allanscope.report.data_pictures import (
    density_picture,
    lag_picture,
    ratio_picture,
    series_picture,
)
from allanscope.report.picture import Picture

__all__ = ["SENSORS", "pictures", "save_pictures"]

SENSORS = {"dps": "gyroscope", "g": "accelerometer"}


def pictures(analysis: Analysis) -> dict[str, Picture]:
    """Return what there is to draw: ``gx-deviation``, ``gyroscope-series``, ``ratio``, ..."""
    shown = {name: axis for name, axis in analysis.axes.items() if "oadev" in axis.curves}
    found: dict[str, Picture] = {}
    for name, axis in shown.items():
        found |= {f"{name}-{what}": one for what, one in _of_axis(name, axis, analysis).items()}
    record = analysis.record
    for unit, sensor in SENSORS.items():
        names = [name for name, axis in shown.items() if axis.unit == unit]
        if record is not None and names:
            found[f"{sensor}-series"] = series_picture(record, names, unit, analysis.marks)
    if shown:
        found["ratio"] = ratio_picture(shown)
    return found


def save_pictures(found: Mapping[str, Picture], folder: Path) -> list[Path]:
    """Write every picture into a folder, as SVG and as PNG; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    return [path for name, one in found.items() for path in one.save(folder / name)]


def _of_axis(name: str, axis: AxisAnalysis, analysis: Analysis) -> dict[str, Picture]:
    found = {"deviation": deviation_picture(name, axis)}
    if axis.explanation is not None and searched(axis.explanation):
        found["residual"] = residual_picture(name, axis)
    if axis.density is not None:
        found["density"] = density_picture(name, axis)
    if analysis.record is not None and len(analysis.record.values):
        found["lag"] = lag_picture(analysis.record, name, axis.unit)
    return found
