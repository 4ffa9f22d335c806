"""What the fitted plant predicts, as it comes: force control, folding, buckling, lateness, speed (08 section 4).

    python -m studies.predict               about a quarter of an hour on two cores
    python -m studies.predict --count 6     a quick look

Nothing here is fitted. Printed is a table in markdown, the printed values of the sources beside it.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import ttest_ind

from rtctl.study.admittance import REGULATED_N, SETS, Printed, law
from rtctl.study.insertions import AS_THE_SOURCES, NO_CONTROL, WELL_REGISTERED, Insertions
from studies.laboratory import Laboratory

BASE = (*WELL_REGISTERED, *AS_THE_SOURCES)
PHANTOM, BONE = "backend.options.trial.specimen=phantom", "backend.options.trial.specimen=bone"
COUNT = 20


@dataclass(frozen=True)
class Case:
    """One row: what is inserted how, and what the sources print of it (mean, post-AOS, peak, lateral force [mN])."""

    name: str
    settings: Sequence[str]
    printed: str = ""
    count: float = 1.0
    """How many insertions, as a multiple of the others."""


def cases() -> list[Case]:
    """Everything that is predicted, and the two sets it was fitted to."""
    late = "backend.options.phantom.stylet_late_mm"
    printed = {one.name: _told(one.printed) for one in SETS}
    found = [
        Case("set 0, phantom (fitted)", [*NO_CONTROL, PHANTOM], printed["0"]),
        Case("set 0b, bone (fitted)", [*NO_CONTROL, BONE], printed["0b"]),
        Case("set 1, K_a 20", [*law(20), PHANTOM], printed["1"]),
        Case("set 2, K_a 50", [*law(50), PHANTOM], printed["2"]),
    ]
    for regulated_n in REGULATED_N:
        named = f"f_reg {regulated_n:g} N"
        found += [
            Case(f"set 3, K_i 50, {named}", [*law(50, 50, regulated_n), PHANTOM], printed["3"]),
            Case(f"set 4, K_i 80, {named}", [*law(50, 80, regulated_n), PHANTOM], printed["4"]),
            Case(f"set 5, bone, {named}", [*law(50, 80, regulated_n), BONE], printed["5"]),
        ]
    found += [
        Case("stylet 0.5 mm early", [*NO_CONTROL, "backend.options.array.stylet_offset_mm=0.5"], "folds, most", 3.0),
        Case("stylet on time", list(NO_CONTROL), "folds, hardly any", 3.0),
        Case("stylet 0.5 mm late", [*NO_CONTROL, f"{late}=0.5"]),
        Case("stylet 1 mm late", [*NO_CONTROL, f"{late}=1.0"]),
    ]
    for offset_mm in (-1.5, -1.0, -0.5, -0.25, 0.25, 0.5, 1.0, 1.5):
        found.append(
            Case(f"entry {offset_mm:+g} mm aside", [*NO_CONTROL, f"backend.options.trial.lateral_mm={offset_mm}"])
        )
    for speed in (0.5, 1.0, 2.0, 3.0):
        found.append(Case(f"{speed:g} mm/s", [*NO_CONTROL, f"workflow.speed_mm_per_s={speed}"], "no difference but at 0.5" if speed == 0.5 else ""))  # fmt: skip
    for offset_mm in (-1.0, 1.0):
        found.append(Case(f"lateral law K_a 50, entry {offset_mm:+g} mm aside", [*law(50), f"backend.options.trial.lateral_mm={offset_mm}"], "corrected, or runs away"))  # fmt: skip
    return found


def _told(printed: Printed) -> str:
    """Mean (SD) / post-AOS / peak / lateral in mN."""
    mean, sd, post, peak, lateral = (
        f"{1e3 * force_n:.0f}"
        for force_n in (printed.mean, printed.mean_sd, printed.post_aos, printed.peak, printed.lateral)
    )
    return f"{mean} ({sd}) / {post} / {peak} / {lateral}"


def row(case: Case, found: Insertions, baseline: Insertions | None) -> str:
    """A row of the table."""
    mean = found.mean_n()
    p = np.nan if baseline is None else ttest_ind(mean, baseline.mean_n(), equal_var=False).pvalue
    forces = " / ".join(
        f"{1e3 * np.nanmean(f):.0f}" for f in (found.post_aos_n(), found.peak_n(), found.lateral_mean_n())
    )
    n = len(found.each)
    return (
        f"| {case.name} | {1e3 * np.nanmean(mean):.0f} ({1e3 * np.nanstd(mean, ddof=1):.0f}) / {forces} "
        f"| {'' if np.isnan(p) else f'{p:.3f}'} | {case.printed} | {100 * found.folded.mean():.0f} % | {100 * found.buckled.mean():.0f} % "
        f"| {np.nanmax(found.largest_correction_mm):.1f} | {found.ended_early.sum()} of {n} |"
    )


HEAD = (
    "| case | mean (SD) / post-AOS / peak / lateral [mN] | p | printed | folded | buckled | largest correction [mm] | ended early |\n"
    "|---|---|---|---|---|---|---|---|"
)


def run(count: int, only: str, report: Callable[[str], None]) -> None:
    """Simulate and print row after row."""
    laboratory = Laboratory()
    baselines: dict[bool, Insertions] = {}
    print(HEAD)
    for number, case in enumerate(cases()):
        bone = BONE in case.settings
        if only not in case.name and bone in baselines:
            continue
        report(f"{number + 1}/{len(cases())} {case.name}")
        seeds = range(10_000, 10_000 + round(case.count * count))
        found = laboratory.insert([*BASE, *case.settings], seeds)
        print(
            row(case, found, baselines.get(bone) if "law" in case.name or case.name.startswith("set") else None),
            flush=True,
        )
        baselines.setdefault(bone, found)
    laboratory.close()


def main(arguments: list[str] | None = None) -> int:
    """Predict and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=COUNT, help=f"insertions of a case [{COUNT}]")
    parser.add_argument("--only", default="", help="cases whose name holds this text")
    chosen = parser.parse_args(arguments)
    run(chosen.count, chosen.only, lambda text: print(text, file=sys.stderr, flush=True))
    return 0


if __name__ == "__main__":
    sys.exit(main())
