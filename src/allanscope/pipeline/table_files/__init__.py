"""Samples in binary files and in folders of them, each kind a module: to columns.

::

    path ─▶ registry: which kind ─┬▶ arrays    .npz, .npy
                                  ├▶ matlab    .mat
                                  ├▶ parquet   .parquet                    ─▶ TableFile
                                  ├▶ rosbag    rosbag2: .mcap, .db3, folder
                                  └▶ hsdatalog folder of FP-SNS-DATALOG2

Nothing in such a file is run: pickled objects are refused. What a header claims is compared with
what the file has before any memory is taken for it, and no more than `MOST_BYTES` is unpacked.

A new kind is a module with a function ``read(path, stream) -> TableFile`` that raises ValueError,
and a line in `registry`.
"""

from __future__ import annotations

from allanscope.pipeline.table_files.base import TableFile
from allanscope.pipeline.table_files.registry import is_table_file, table_of_file

__all__ = ["TableFile", "is_table_file", "table_of_file"]
