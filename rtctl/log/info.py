"""What a log tells about its run at a glance."""

from typing import Any

from rtctl.log.format import CONTROLLER
from rtctl.log.reader import Log


def describe(log: Log) -> dict[str, Any]:
    """Name -> value, in the order in which one wants to read them; units are in the names.

    ``outcomes`` are the events that carry an ``outcome``; facts the header does not hold are None.
    """
    rows = log.rows.get(CONTROLLER)
    empty = rows is None or not len(rows)
    duration_s = 0.0 if rows is None or empty else float(rows["time_ns"][-1] - rows["time_ns"][0]) * 1e-9
    missing = [] if empty else log.missing_ticks()
    return {
        "files": [str(path) for path in log.paths],
        "size_bytes": log.size_bytes,
        "complete": log.complete,
        "lost_bytes": log.lost_bytes,
        "duration_s": duration_s,
        "rows": 0 if rows is None else len(rows),
        "rate_hz": 0.0 if rows is None or duration_s == 0.0 else (len(rows) - 1) / duration_s,
        "first_tick": None if rows is None or empty else int(rows["tick"][0]),
        "last_tick": None if rows is None or empty else int(rows["tick"][-1]),
        "missed_ticks": 0 if rows is None else int(rows["missed_ticks"].sum()),
        "gaps": missing,
        "lost_ticks": sum(last - first + 1 for first, last in missing),
        "grade": log.header.get("grade"),
        "config_hash": log.header.get("config_hash"),
        "seed": log.header.get("seed"),
        "kernel_hash": log.header.get("kernel_hash"),
        "certificate": log.header.get("certificate") or None,
        "hashed_seconds": len(log.hashes),
        "outcomes": [event for event in log.events if "outcome" in event],
        "topics": {topic: len(items) for group in (log.rows, log.messages) for topic, items in group.items()},
    }
