"""What the kernel has counted for a process."""

from dataclasses import dataclass, fields

from rtctl.readiness.facts import Facts, Unreadable

STATUS = {
    "resident_kib": "VmRSS",
    "locked_kib": "VmLck",
    "voluntary_switches": "voluntary_ctxt_switches",
    "involuntary_switches": "nonvoluntary_ctxt_switches",
}
MINOR, MAJOR = 7, 9
"""Columns of /proc/PID/stat after the name: page faults without and with a disk."""


@dataclass(frozen=True)
class Usage:
    """Of one process up to now; None where the kernel does not tell."""

    resident_kib: int | None
    locked_kib: int | None
    minor_faults: int | None
    major_faults: int | None
    voluntary_switches: int | None
    involuntary_switches: int | None


def usage_of(pid: int, facts: Facts) -> Usage:
    """Look at the process; never an error."""
    status, stat = _text(facts, f"proc/{pid}/status"), _text(facts, f"proc/{pid}/stat")
    lines = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
    numbers = {name: _number(lines.get(key, "")) for name, key in STATUS.items()}
    words = stat.rpartition(")")[2].split()
    return Usage(**numbers, minor_faults=_word(words, MINOR), major_faults=_word(words, MAJOR))


def gained(before: Usage, after: Usage) -> dict[str, int | None]:
    """What was added between two looks, by name; None where either did not tell."""
    pairs = {f.name: (getattr(before, f.name), getattr(after, f.name)) for f in fields(Usage)}
    return {name: None if a is None or b is None else b - a for name, (a, b) in pairs.items()}


def _text(facts: Facts, path: str) -> str:
    try:
        return facts.text(path)
    except Unreadable:
        return ""


def _word(words: list[str], column: int) -> int | None:
    return _number(words[column]) if len(words) > column else None


def _number(text: str) -> int | None:
    first = text.split()[0] if text.split() else ""
    return int(first) if first.isdecimal() else None
