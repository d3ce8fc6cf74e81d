"""What is written of a lot: the table of all results, and the report that is made from it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from allanscope.fleet.store import Store
from allanscope.fleet.table import rows_of, write_table
from allanscope.fleet.units import UnitNames

if TYPE_CHECKING:
    from allanscope.fleet.desk import FleetResult
    from allanscope.fleet.run import FleetSettings

__all__ = ["write_lot"]


def write_lot(result: FleetResult, store: Store, settings: FleetSettings) -> None:
    """Write ``lot.parquet`` and ``lot.html`` of all recordings that have a result.

    Raises
    ------
    UsageError
        If they cannot be written, or the pattern that names units makes no sense.
    """
    names = UnitNames(result.keys, settings.unit_pattern)
    table = store.folder / "lot.parquet"
    if not write_table(table, _rows(result, store, names)):
        table.unlink()
        return
    result.table = table
    from allanscope.fleet.lot import Lot
    from allanscope.fleet.page import render_lot
    from allanscope.pipeline.outputs import write_whole

    report = store.folder / "lot.html"
    write_whole(report, render_lot(Lot.read(table), result.failures))
    result.report = report


def _rows(result: FleetResult, store: Store, names: UnitNames) -> Iterator[dict[str, Any]]:
    """Yield the rows of all recordings in the order of their names."""
    for url in sorted(result.keys):
        try:
            kept = store.get(result.keys[url])
        except (OSError, ValueError) as error:
            result.failures[url] = f"{url}: {error}; run the fleet again"
            store.forget(result.keys.pop(url))
            continue
        yield from rows_of(url, names.of(url, kept["circumstances"]), kept)
