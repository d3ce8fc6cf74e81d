"""What is written of a lot: the table of all results, and the report that is made from it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from allanscope.fleet.losses import loss_of
from allanscope.fleet.result_folder import staged
from allanscope.fleet.store import Store
from allanscope.fleet.table import rows_of, write_table
from allanscope.fleet.units import UnitNames

if TYPE_CHECKING:
    from allanscope.fleet.desk import FleetResult
    from allanscope.fleet.run import FleetSettings

__all__ = ["copies_among", "write_lot"]


def write_lot(result: FleetResult, store: Store, settings: FleetSettings) -> None:
    """Write ``lot.parquet`` and ``lot.html`` of all recordings that have a result.

    Copies of a recording are left out: they are no units and no repeats.

    Raises
    ------
    UsageError
        If they cannot be written, or the pattern that names units makes no sense.
    """
    result.copies = copies_among(result.keys)
    originals = result.keys.keys() - result.copies.keys()
    names = UnitNames(originals, settings.unit_pattern)
    with staged(store.folder) as here:
        table = here / "lot.parquet"
        if not write_table(table, _rows(result, sorted(originals), store, names)):
            table.unlink()
            return
        from allanscope.fleet.lot import Lot
        from allanscope.fleet.page import render_lot
        from allanscope.pipeline.outputs import write_whole

        page = render_lot(Lot.read(table), result.failures, result.copies)
        write_whole(here / "lot.html", page)
    result.table = store.folder / "lot.parquet"
    result.report = store.folder / "lot.html"


def copies_among(keys: Mapping[str, str]) -> dict[str, str]:
    """Return the recordings of the same content as one before them by name, and that one.

    >>> copies_among({"b.mcap": "1", "a.mcap": "1", "c.mcap": "2"})
    {'b.mcap': 'a.mcap'}
    """
    first: dict[str, str] = {}
    for url in sorted(keys):
        first.setdefault(keys[url], url)
    return {url: first[keys[url]] for url in sorted(keys) if first[keys[url]] != url}


def _rows(
    result: FleetResult, urls: list[str], store: Store, names: UnitNames
) -> Iterator[dict[str, Any]]:
    """Yield the rows of some recordings; note what they lack."""
    for url in urls:
        try:
            kept = store.get(result.keys[url])
        except (OSError, ValueError) as error:
            result.failures[url] = f"{url}: {error}; run the fleet again"
            store.forget(result.keys.pop(url))
            continue
        loss = loss_of(url, kept)
        if loss is not None:
            result.losses.append(loss)
        yield from rows_of(url, names.of(url, kept["circumstances"]), kept)
    result.losses.sort(key=lambda one: -one.share)
