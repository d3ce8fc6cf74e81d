"""What is written of a lot: which board each recording is of, the table, and the report of it."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from allanscope.atomic_write import atomic_folder
from allanscope.errors import InputError, UsageError
from allanscope.fleet.inputs import RemotePath
from allanscope.fleet.lot import Lot, rows_of, write_table
from allanscope.fleet.outcome import loss_of
from allanscope.fleet.store import Store, result_folder, staged
from allanscope.pipeline import Limits

if TYPE_CHECKING:
    from allanscope.fleet.run import FleetSettings
    from allanscope.fleet.work_queue import FleetResult

__all__ = ["UnitNames", "find_duplicates", "find_lot", "write_lot"]

_IDENTITIES = ("unit", "unique_id", "serial_number")
"""What a recording says of its board, the best first: a name given at import, the controller's own
number, the USB serial number."""


def write_lot(
    result: FleetResult, store: Store, settings: FleetSettings, limits: Limits | None = None
) -> None:
    """Write ``lot.parquet``, ``lot.html`` and ``units/`` of all recordings that have a result.

    Copies of a recording are left out: they are no units and no repeats.

    Raises
    ------
    UsageError
        If they cannot be written, or the pattern that names units is not possible.
    """
    from allanscope.view import progress

    result.copies = find_duplicates(result.keys)
    originals = sorted(result.keys.keys() - result.copies.keys())
    names = UnitNames(originals, settings.unit_pattern)
    with staged(store.folder) as folder:
        table = folder / "lot.parquet"
        with progress(
            float(len(originals)), "table", unit="recordings", quiet=settings.quiet
        ) as advance:
            rows = _rows(result, originals, store, names, advance)
            first = next(rows, None)
            if first is None:  # what an earlier run left stays
                return
            if table.is_dir() and not settings.partition:
                shutil.rmtree(table)  # of a run that parted it
            write_table(table, chain([first], rows), settings.partition)
        from allanscope.atomic_write import write_text
        from allanscope.fleet.acceptance import accept
        from allanscope.fleet.page import STAGES, render_lot

        lot = Lot.read(table, limits=bool(limits))
        result.acceptance = accept(lot, limits) if limits else None
        with (
            progress(float(STAGES), "report", unit="parts", quiet=settings.quiet) as advance,
            atomic_folder(folder / "units") as pages,
        ):
            page = render_lot(
                lot,
                result.failures,
                result.copies,
                acceptance=result.acceptance,
                other=find_lot(settings.compare),
                other_name=settings.compare,
                put_page=lambda name, text: write_text(pages / name, text),
                advance=advance,
            )
        write_text(folder / "lot.html", page)
    result.table = store.folder / "lot.parquet"
    result.report = store.folder / "lot.html"


def find_lot(place: str) -> Lot | None:
    """Return the lot to compare with: the folder of a fleet's results, at a URL too, or a table.

    Raises
    ------
    InputError
        If there is no table.
    """
    if not place:
        return None
    try:
        folder = result_folder(place)
        if isinstance(folder, Path):
            table = folder / "lot.parquet"
            return Lot.read(table if table.exists() else folder)
        with TemporaryDirectory(prefix="allanscope-") as copies:
            return Lot.read(_downloaded(folder, Path(copies)))
    except (OSError, ValueError, KeyError) as error:
        why = getattr(error, "strerror", None) or str(error).partition("\n")[0]
        raise InputError(f"{place} is not the result of a fleet: {why}") from None


def _downloaded(remote: RemotePath, folder: Path) -> Path:
    """Return a copy of a table, or of the one in a folder; of a partitioned one all its files."""
    source = remote if remote.suffix == ".parquet" else remote / "lot.parquet"
    table = folder / "lot.parquet"
    parts = {
        part.url.rpartition(f"/{source.name}/")[2]: part
        for part in source.glob("**/*.parquet")
        if f"/{source.name}/" in part.url and ".." not in part.url.split("/")
    }
    for name, part in parts.items():
        (table / name).parent.mkdir(parents=True, exist_ok=True)
        (table / name).write_bytes(part.read_bytes())
    if not parts:
        table.write_bytes(source.read_bytes())
    return table


def find_duplicates(keys: Mapping[str, str]) -> dict[str, str]:
    """Return the recordings of the same content as one before them by name, and that one.

    >>> find_duplicates({"b.mcap": "1", "a.mcap": "1", "c.mcap": "2"})
    {'b.mcap': 'a.mcap'}
    """
    first: dict[str, str] = {}
    for url in sorted(keys):
        first.setdefault(keys[url], url)
    return {url: first[keys[url]] for url in sorted(keys) if first[keys[url]] != url}


def _rows(
    result: FleetResult,
    urls: list[str],
    store: Store,
    names: UnitNames,
    advance: Callable[[float], None],
) -> Iterator[dict[str, Any]]:
    """Yield the rows of some recordings; note what they lack."""
    for url in urls:
        advance(1.0)
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


class UnitNames:
    r"""Names the unit of a recording.

    A pattern overrules what the recording says of its board, and that overrules where it lies. By
    place, all recordings of a folder are runs of one unit; where all lie in one folder nothing
    tells which belong together, and each is a unit of its own.

    Parameters
    ----------
    urls : iterable of str
        All recordings of the lot.
    pattern : str
        Regular expression whose first group, found in the path, is the name; empty for none.

    Raises
    ------
    UsageError
        If it is not a regular expression with a group.

    Examples
    --------
    >>> names = UnitNames(["/lot/a/1.mcap", "/lot/a/2.mcap", "/lot/b/1.mcap"])
    >>> names.of("/lot/a/2.mcap", {}), names.of("/lot/b/1.mcap", {"serial_number": "0042"})
    ('a', '0042')
    >>> UnitNames(["/lot/a7-1.mcap"], r"/(\w+)-").of("/lot/a7-1.mcap", {})
    'a7'
    """

    def __init__(self, urls: Iterable[str], pattern: str = "") -> None:
        self._by_folder = len({PurePosixPath(url).parent for url in urls}) > 1
        try:
            self._pattern = re.compile(pattern) if pattern else None
        except re.error as error:
            raise UsageError(
                f"--unit-name {pattern!r} is not a regular expression: {error}"
            ) from None
        if self._pattern is not None and self._pattern.groups < 1:
            raise UsageError(f"--unit-name {pattern!r} has no group; write e.g. '/(unit-[0-9]+)/'")

    def of(self, url: str, circumstances: Mapping[str, Any]) -> str:
        """Return the name of the unit of one recording."""
        found = self._pattern.search(url) if self._pattern is not None else None
        if found is not None and found[1]:
            return str(found[1])
        for name in _IDENTITIES:
            if circumstances.get(name):
                return str(circumstances[name])
        path = PurePosixPath(url)
        return path.parent.name if self._by_folder else path.stem
