"""The sets of the admittance study (D Tables VI.2 and VI.3) on the plant, with the printed numbers beside them.

Registration errors and properties of array and tissue are drawn as `[backend.options.phantom]` and `.bone` say. Nothing is
tuned for a set: they differ by the gains of Table VI.2 alone. The regulated force f_reg is printed nowhere, so sets with
a stylet law are run over a range of it.
"""

import csv
import math
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from scipy.stats import ttest_ind

from rtctl.campaign import Standing
from rtctl.campaign.workers import results_of
from rtctl.electrode.planning import Plan
from rtctl.planner import plan_of
from rtctl.settings import Settings, load
from rtctl.study.insertions import AS_THE_SOURCES, WELL_REGISTERED, Insertion, Insertions, insert

REGULATED_N = (-0.05, -0.10, -0.15)
SEEDS_APART = 1000
"""Between the first seeds of two sets."""


class Printed(NamedTuple):
    """A column of Table VI.3 [N]; deviations are over insertions."""

    mean: float
    mean_sd: float
    post_aos: float
    post_aos_sd: float
    peak: float
    lateral: float
    lateral_sd: float


@dataclass(frozen=True)
class Set:
    """A row of Table VI.2: gains in mm/(N s), 0 for off."""

    name: str
    specimen: str
    count: int
    lateral_gain: float
    stylet_gain: float
    printed: Printed

    @property
    def baseline(self) -> str:
        """The set without control it is compared with."""
        return "0" if self.specimen == "phantom" else "0b"


SETS = (
    Set("0", "phantom", 95, 0.0, 0.0, Printed(0.042, 0.023, 0.047, 0.028, 0.190, 0.016, 0.016)),
    Set("0b", "bone", 8, 0.0, 0.0, Printed(0.071, 0.033, 0.110, 0.058, 0.284, 0.026, 0.030)),
    Set("1", "phantom", 5, 20.0, 0.0, Printed(0.052, 0.029, 0.076, 0.042, 0.186, 0.022, 0.014)),
    Set("2", "phantom", 5, 50.0, 0.0, Printed(0.062, 0.034, 0.091, 0.041, 0.168, 0.026, 0.013)),
    Set("3", "phantom", 5, 50.0, 50.0, Printed(0.037, 0.018, 0.050, 0.023, 0.124, 0.018, 0.014)),
    Set("4", "phantom", 5, 50.0, 80.0, Printed(0.044, 0.021, 0.056, 0.036, 0.134, 0.024, 0.018)),
    Set("5", "bone", 5, 50.0, 80.0, Printed(0.046, 0.005, 0.051, 0.021, 0.143, 0.031, 0.023)),
)


def law(lateral_gain: float, stylet_gain: float = 0.0, regulated_n: float = math.nan) -> list[str]:
    """Settings of the force laws with gains in mm/(N s), 0 for off; NaN leaves f_reg what it is."""
    settings = [
        f"admittance.lateral={str(lateral_gain > 0).lower()}",
        f"admittance.stylet={str(stylet_gain > 0).lower()}",
        f"admittance.lateral_gain_mm_per_n_s={lateral_gain}",
        f"admittance.stylet_gain_mm_per_n_s={stylet_gain}",
    ]
    if not math.isnan(regulated_n):
        settings.append(f"admittance.regulated_force_n={regulated_n}")
    return settings


@dataclass(frozen=True)
class Case:
    """A set at one regulated force; NaN where it has no stylet law."""

    set: Set
    regulated_n: float
    seeds: range

    @property
    def name(self) -> str:
        """As it stands in tables and legends."""
        law = "" if math.isnan(self.regulated_n) else f", f_reg {self.regulated_n:g} N"
        return f"set {self.set.name}{law}"

    def settings(self) -> Settings:
        """Settings of its insertions, on top of planar-sim."""
        specimen = f"backend.options.trial.specimen={self.set.specimen}"
        laws = law(self.set.lateral_gain, self.set.stylet_gain, self.regulated_n)
        return load("planar-sim", [*WELL_REGISTERED, *AS_THE_SOURCES, specimen, *laws])


def cases(first_seed: int = 0, sets: Iterable[Set] = SETS) -> list[Case]:
    """All sets in order, those with a stylet law once for each regulated force, with the same seeds."""
    found = []
    for number, one in enumerate(sets):
        start = first_seed + SEEDS_APART * number
        for regulated_n in REGULATED_N if one.stylet_gain > 0 else (math.nan,):
            found.append(Case(one, regulated_n, range(start, start + one.count)))
    return found


def run(todo: list[Case], jobs: int = 1, report: Callable[[Standing], None] = lambda _: None) -> list[Insertions]:
    """The insertions of every case.

    Args:
        jobs: processes to use.
        report: is told after each insertion; failed are those that ended early.

    Raises:
        CampaignError: a process was killed. RtctlError: a set cannot be simulated.
    """
    settings = [case.settings() for case in todo]
    items = [(number, seed) for number, case in enumerate(todo) for seed in case.seeds]
    found: list[list[Insertion]] = [[] for _ in todo]
    failed = 0
    report(Standing(0, len(items), 0))
    with closing(results_of(partial(_insert, settings, plan_of(settings[0])), items, jobs)) as results:
        for done, ((number, _), insertion) in enumerate(zip(items, results, strict=True), 1):
            found[number].append(insertion)
            failed += bool(insertion.failed)
            report(Standing(done, len(items), failed))
    return [Insertions(each) for each in found]


def _insert(settings: list[Settings], plan: Plan, item: tuple[int, int]) -> Insertion:
    number, seed = item
    return insert(settings[number], plan, seed)


HEAD = (
    "| set | N | insertion force | p | post-AOS | p | peak | lateral | largest correction | folded, buckled, ended early |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)


def table(todo: list[Case], found: list[Insertions]) -> str:
    """Table VI.3 in markdown: forces in mN, means with deviations over insertions, the printed ones in italics.

    p: one-sided t-test (Welch) in the direction of the difference against the set without control, as printed.
    """
    baselines = {case.set.name: insertions for case, insertions in zip(todo, found, strict=True)}
    lines, told = [HEAD], set()
    for case, insertions in zip(todo, found, strict=True):
        one, printed = case.set, case.set.printed
        if one.name not in told:
            told.add(one.name)
            lines.append(
                f"| *{one.name}, printed* | *{one.count}* | *{_mn(printed.mean)} ({_mn(printed.mean_sd)})* | "
                f"| *{_mn(printed.post_aos)} ({_mn(printed.post_aos_sd)})* | | *{_mn(printed.peak)}* "
                f"| *{_mn(printed.lateral)} ({_mn(printed.lateral_sd)})* | | |"
            )
        other = baselines.get(one.baseline) if one.name != one.baseline else None
        mean, post, lateral = insertions.mean_n(), insertions.post_aos_n(), insertions.lateral_mean_n()
        others = (None, None) if other is None else (other.mean_n(), other.post_aos_n())
        lines.append(
            f"| {case.name} | {len(insertions.each)} | {_spread(mean)} | {_p(mean, others[0])} "
            f"| {_spread(post)} | {_p(post, others[1])} | {_mn(insertions.peak_n().mean())} "
            f"| {_spread(lateral)} | {np.nanmax(insertions.largest_correction_mm):.1f} mm "
            f"| {insertions.folded.sum()}, {insertions.buckled.sum()}, {insertions.ended_early.sum()} |"
        )
    return "\n".join(lines) + "\n"


def _mn(force_n: float) -> str:
    """As it stands in the tables: millinewtons."""
    return f"{1e3 * force_n:.0f}"


def _spread(values_n: np.ndarray) -> str:
    return f"{_mn(values_n.mean())} ({_mn(values_n.std(ddof=1)) if values_n.size > 1 else '-'})"


def _p(values: np.ndarray, others: np.ndarray | None) -> str:
    """One-sided p of the difference that is there; empty without others, or of too few."""
    if others is None or min(values.size, others.size) < 2:
        return ""
    side: Literal["greater", "less"] = "greater" if values.mean() > others.mean() else "less"
    return f"{ttest_ind(values, others, equal_var=False, alternative=side).pvalue:.3f}"


def write_rows(path: Path, todo: list[Case], found: list[Insertions]) -> None:
    """Every insertion as a row of CSV: set, regulated force, seed, what was drawn, forces [N], correction, what became of it."""
    names = tuple(found[0].each[0].drawn)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["set", "regulated_force_n", "seed", *names, "mean_n", "post_aos_n", "peak_n", "lateral_n", "correction_mm",
             "largest_correction_mm", "folded", "buckled", "failed"]
        )  # fmt: skip
        for case, insertions in zip(todo, found, strict=True):
            for seed, each in zip(case.seeds, insertions.each, strict=True):
                one = Insertions([each])
                forces = [_only(f) for f in (one.mean_n(), one.post_aos_n(), one.peak_n(), one.lateral_mean_n())]
                writer.writerow(
                    [case.set.name, "" if math.isnan(case.regulated_n) else case.regulated_n, seed, *(each.drawn[name] for name in names), *forces,
                     each.correction_mm, each.largest_correction_mm, int(each.folded), int(each.buckled), each.failed]
                )  # fmt: skip


def _only(values: np.ndarray) -> float | str:
    return float(values[0]) if values.size else ""
