"""Verify: data whose results are known, through everything that makes a number, on any machine.

::

    certified   data sets, published values, exact answers in rational numbers
        └──▶ checks ──▶ one table, and a JSON that can be filed

A value that was published is met to the digits that were published, a rational answer to twelve
digits, and the running sums of integers, through which every sample of a stream goes, to the last
bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from allanscope.lazy import lazily

if TYPE_CHECKING:
    from allanscope.verify.checks import Check, table_lines, to_json, verify

__all__ = ["Check", "table_lines", "to_json", "verify"]

__getattr__, __dir__ = lazily(
    __name__,
    {"Check": "checks", "table_lines": "checks", "to_json": "checks", "verify": "checks"},
)
