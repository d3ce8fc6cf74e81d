"""The table of a lot in memory, by columns: what the report is reckoned from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from allanscope.samples import AXES

__all__ = ["Lot"]

_UNREAD = ("remarks", "sha256", "firmware", "unique_id", "serial_number")


@dataclass(frozen=True)
class Lot:
    """Rows of the table, one for each recording and axis.

    Attributes
    ----------
    columns : mapping
        Name to values, shape (n,): numbers are floats, with NaN for what is not known; truths are
        floats too; texts and effects are objects.
    """

    columns: Mapping[str, NDArray[Any]]

    @classmethod
    def read(cls, table: Path) -> Lot:
        """Return what a table holds, without the columns that no report needs."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        with table.open("rb") as file:  # by us: Arrow takes no names that are not UTF-8
            names = [name for name in pq.read_schema(file).names if name not in _UNREAD]
            read = pq.read_table(file, columns=names)
        columns: dict[str, NDArray[Any]] = {}
        for name in names:
            column = read.column(name)
            if pa.types.is_string(column.type) or pa.types.is_list(column.type):
                values = np.empty(len(column), object)
                values[:] = column.to_pylist()
                columns[name] = values
            else:
                columns[name] = np.array(
                    [np.nan if one is None else float(one) for one in column.to_pylist()]
                )
        return cls(columns)

    def __len__(self) -> int:
        return len(self.columns["axis"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def axes(self) -> list[str]:
        """Names of the axes that there are, in the order of the samples."""
        here = set(self["axis"].tolist())
        return [axis for axis in AXES if axis in here]

    @property
    def units(self) -> NDArray[np.str_]:
        """The unit of each row."""
        return self["unit"].astype(np.str_)

    def where(self, mask: NDArray[np.bool_]) -> Lot:
        """Return some of the rows."""
        return Lot({name: values[mask] for name, values in self.columns.items()})

    def of_axis(self, axis: str) -> Lot:
        """Return the rows of one axis."""
        return self.where(self["axis"] == axis)

    def detected(self, name: str) -> Lot:
        """Return the rows in which a coefficient was found, and not only an upper limit for it."""
        return self.where((self[f"{name}_detected"] == 1.0) & (self[f"{name}_value"] > 0.0))
