"""What one look at the machine gives."""

import enum
from dataclasses import dataclass


class Verdict(enum.StrEnum):
    """What a finding means for the loop."""

    GOOD = "good"
    COSTS = "costs"
    UNKNOWN = "unknown"
    """it could not be read; nothing is assumed"""


@dataclass(frozen=True)
class Finding:
    """One line of ``rtctl doctor``: what was looked at and found, what it costs, and the one command that mends it."""

    name: str
    found: str
    verdict: Verdict
    cost: str = ""
    remedy: str = ""


def good(name: str, found: str) -> Finding:
    """Nothing to mend."""
    return Finding(name, found, Verdict.GOOD)


def costs(name: str, found: str, cost: str, remedy: str) -> Finding:
    """Something that makes the loop late, and how to be rid of it."""
    return Finding(name, found, Verdict.COSTS, cost, remedy)


def unknown(name: str, why: str, remedy: str = "") -> Finding:
    """What could not be read, and why."""
    return Finding(name, f"could not be read: {why}", Verdict.UNKNOWN, "", remedy)
