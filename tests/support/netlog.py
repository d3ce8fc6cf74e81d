"""What a browser asks the network for, as it writes down itself."""

from __future__ import annotations

import json
from pathlib import Path

__all__ = ["NETLOG", "asked_for"]

NETLOG = "--log-net-log={}"
_UNKNOWN = "not an origin"


def asked_for(log: Path) -> set[tuple[str, str]]:
    """Return pairs of a page's origin and what it asked for, not what the browser itself wants.

    The log of a browser that was terminated has no end, and is read all the same.
    """
    text = log.read_text("utf-8", errors="replace")
    head, _, events = text.partition('"events": [')
    constants = json.loads(head.rstrip().rstrip(",") + "}")["constants"]["logEventTypes"]
    wanted = constants["URL_REQUEST_START_JOB"]
    found = set()
    for line in events.splitlines():
        try:
            event = json.loads(line.rstrip().rstrip(","))
        except ValueError:
            continue
        known = event.get("params", {}) if isinstance(event, dict) else {}
        if event.get("type") == wanted and known.get("initiator", _UNKNOWN) != _UNKNOWN:
            found.add((known["initiator"], known["url"]))
    return found
