"""What the bench found: figures with their references and targets, as a table for people and as JSON for programs."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np
from rich.table import Table

T = TypeVar("T")


@dataclass(frozen=True)
class Target:
    """A promise: at most, or at least, so much."""

    bound: float
    at_least: bool = False

    def met(self, value: float) -> bool:
        """False for NaN, too."""
        return value >= self.bound if self.at_least else value <= self.bound

    def __str__(self) -> str:
        return f"{'≥' if self.at_least else '≤'} {self.bound:g}"


@dataclass(frozen=True)
class Figure:
    """One measurement.

    Attributes:
        part: of the bench.
        name: what was measured.
        measured: in `unit`; None if it could not be measured, and `note` says why.
        reference: the same of what it is compared with, which `reference_name` tells.
        ratio: median of the ratios to the reference, round by round, with its quartiles.
        target: bound of the ratio if there is one, else of `measured`.
    """

    part: str
    name: str
    unit: str
    measured: float | None
    reference: float | None = None
    reference_name: str = ""
    ratio: float | None = None
    quartiles: tuple[float, float] | None = None
    target: Target | None = None
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None without a target or a measurement."""
        value = self.measured if self.ratio is None else self.ratio
        return None if self.target is None or value is None else self.target.met(value)

    def as_table(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self) | {"met": self.met}


def compare(
    part: str,
    name: str,
    unit: str,
    ours: Sequence[float],
    theirs: Sequence[float],
    *,
    reference_name: str,
    target: Target,
    note: str = "",
) -> Figure:
    """Figure of measurements taken in turns, one pair a round: the ratio is that within a round."""
    ratios = np.asarray(ours) / np.asarray(theirs)
    low, middle, high = (float(q) for q in np.percentile(ratios, (25, 50, 75)))
    return Figure(
        part,
        name,
        unit,
        float(np.median(ours)),
        float(np.median(theirs)),
        reference_name,
        middle,
        (low, high),
        target,
        note,
    )


def in_turns(rounds: int, *measure: Callable[[], T]) -> list[list[T]]:
    """Results of every function, (functions, rounds): one of each a round, in an order that turns round each time."""
    results: list[list[T]] = [[] for _ in measure]
    for number in range(rounds):
        order = range(len(measure)) if number % 2 == 0 else reversed(range(len(measure)))
        for k in order:
            results[k].append(measure[k]())
    return results


def table(figures: Sequence[Figure]) -> Table:
    """Everything at a glance."""
    result = Table(title="rtctl bench", title_justify="left")
    for heading in ("Part", "Figure"):
        result.add_column(heading, no_wrap=True)
    for heading in ("Measured", "Reference", "Ratio (quartiles)", "Target", "Met"):
        result.add_column(heading, justify="right", no_wrap=True)
    result.add_column("Note")
    part = ""
    for f in figures:
        if part and f.part != part:
            result.add_section()
        result.add_row(
            f.part if f.part != part else "",
            f.name,
            "-" if f.measured is None else f"{f.measured:.4g} {f.unit}",
            "" if f.reference is None else f"{f.reference:.4g} {f.unit} ({f.reference_name})",
            "" if f.quartiles is None else f"{f.ratio:.3f} ({f.quartiles[0]:.3f}..{f.quartiles[1]:.3f})",
            "" if f.target is None else str(f.target),
            {True: "[green]yes[/]", False: "[red]NO[/]", None: ""}[f.met],
            f.note,
        )
        part = f.part
    return result
