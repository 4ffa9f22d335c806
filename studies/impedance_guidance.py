"""Impedance guidance against the plant: what a late stylet costs, and how much of it the law gives back (04 section 4).

    python -m studies.impedance_guidance              two minutes
    python -m studies.impedance_guidance --count 3    a quick look
    python -m studies.impedance_guidance --fit        the power law fitted to the boundary-element model (04 section 3)

Every array is calibrated in a bath first. Nothing here is tuned: the law has the parameters of the sources. Printed are
tables in markdown.
"""

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context

import numpy as np

from hal.errors import RtctlError
from rtctl.electrode.planning import Plan
from rtctl.guidance.impedance import fit, saline
from rtctl.guidance.impedance.jacobian import impedance_rate
from rtctl.guidance.impedance.layout import CONTACTS
from rtctl.guidance.impedance.power_law import FAR_FIELD_OHM
from rtctl.lifecycle import Task
from rtctl.lockstep import Lockstep
from rtctl.planner import plan_of
from rtctl.settings import load
from rtctl.simulation import LockstepOperator, Recorder
from rtctl.study.insertions import AS_THE_SOURCES, NO_CONTROL, WELL_REGISTERED
from rtctl.workflow import insert_array

BASE = (*WELL_REGISTERED, *AS_THE_SOURCES, *NO_CONTROL)
COUNT, FIRST_SEED = 10, 30_000
BATH_TICKS = 15_000
APICAL = 13
"""Contacts 0 to 12: with the fitted array they do not come to the modiolus."""
PASSAGE_MM = 7.0
"""From this depth on, where the law is fully on, distances are averaged over the insertion, too."""
LATE_MM = (0.0, 0.5, 1.0, 1.5)
MODES = {
    "off": (),
    "continuous": ("impedance.guidance=true",),
    "stepwise, 1 mm": ("impedance.guidance=true", "impedance.mode=stepwise", "impedance.interval_mm=1.0"),
}


@dataclass(frozen=True)
class Outcome:
    """One insertion, by truth but for what the law says of itself.

    stylet_mm: withdrawal at the end. offset_mm: what the law added. apical_mm, basal_mm: distance from the modiolus at the
    end, mean of contacts 0 to 12 and of the others inside. passage_mm: mean of all inside, over the insertion from
    PASSAGE_MM on. impedance_ohm: mean of the pairs inside at the end, without leads and noise. resistance_n, peak_n: mean
    and largest force against the insertion. norm: median |J| of the evaluations [ohm/mm]. apical_share: of J^T J that comes
    from the pairs of the apical contacts, at the last evaluation.
    """

    stylet_mm: float
    offset_mm: float
    apical_mm: float
    basal_mm: float
    passage_mm: float
    impedance_ohm: float
    resistance_n: float
    peak_n: float
    norm: float
    apical_share: float
    folded: bool
    failed: str


def bias_of(overrides: Sequence[str], seed: int, far_field_ohm: float = FAR_FIELD_OHM) -> list[float]:
    """Bias of every pair [ohm] of the array this seed gives, from a bath, so that far field reads c as in (VII.21)."""
    settings = load("planar-sim", [*overrides, "impedance.guidance=false", "backend.options.impedance.bath=true"])
    blocks: list[np.ndarray] = []
    lockstep = Lockstep(settings, seed, lambda records, _: blocks.append(records))
    lockstep.advance(BATH_TICKS)
    lockstep.close()
    pair, ohm = saline.samples_of(np.concatenate(blocks))
    z = settings.impedance
    return saline.calibrate(pair, ohm, z, CONTACTS - z.pair_step, far_field_ohm).bias_ohm.tolist()


def insert(overrides: Sequence[str], plan: Plan, seed: int, far_field_ohm: float = FAR_FIELD_OHM) -> Outcome:
    """Calibrate, then insert."""
    bias = bias_of(overrides, seed, far_field_ohm)
    settings = load("planar-sim", [*overrides, f"impedance.bias_ohm={bias}"])
    recorder = Recorder()
    passage: list[float] = []

    def look(records: np.ndarray, truths: np.ndarray) -> None:
        recorder.take(records, truths)
        last = records[-1]
        if last["task_state"] == Task.INSERTING and last["depth_mm"] > PASSAGE_MM:
            passage.append(float(np.nanmean(lockstep.device.device[0]["impedance"]["modiolar_distance_mm"])))

    lockstep = Lockstep(settings, seed, look)
    failed = ""
    try:
        insert_array(LockstepOperator(lockstep, recorder, plan), settings, lockstep.controller.robot)
    except RtctlError as error:
        failed = str(error)
    device = lockstep.device.device[0]
    distance, law = device["impedance"]["modiolar_distance_mm"].copy(), device["impedance"]
    mean = np.maximum((distance[:-1] + distance[1:]) / 2, law["distance_min_mm"])
    area = np.minimum(mean * law["pitch_mm"], law["area_max_mm2"])
    z = law["factor_ohm"] * area ** law["exponent"] + law["far_field_ohm"]
    records, truths = recorder.rows()
    rows = records[records["task_state"] == Task.INSERTING]
    norm = rows["impedance_jacobian_norm"][np.diff(rows["impedance_step_mm"], prepend=np.nan) != 0.0]
    lockstep.close()
    known = rows["force_axial_n"][np.isfinite(rows["force_axial_n"])]
    return Outcome(
        float(truths["stylet_mm"][-1]),
        float(records["impedance_offset_mm"].max()),
        float(np.nanmean(distance[:APICAL])),
        float(np.nanmean(distance[APICAL:])),
        float(np.mean(passage)),
        float(np.nanmean(z)),
        float(-known.mean()) if known.size else np.nan,
        float(-known.min()) if known.size else np.nan,
        float(np.nanmedian(norm)) if np.isfinite(norm).any() else np.nan,
        apical_share(lockstep),
        bool(truths["folded"][-1]),
        failed,
    )


def apical_share(lockstep: Lockstep) -> float:
    """Share of the pairs of the apical contacts in J^T J, as the controller last knew it; NaN if it was not asked."""
    memory = lockstep.controller.memory[0]
    law, pairs = memory["parameters"]["impedance_law"], memory["pairs"]
    if not law["on"]:
        return np.nan
    rate = [impedance_rate(law, pairs["gain"], z, k) for k, z in enumerate(pairs["z_ohm"][: law["pairs"]])]
    squares = np.array(rate) ** 2
    return float(np.nansum(squares[: APICAL - law["pair_step"]]) / np.nansum(squares))


HEAD = (
    "| stylet | guidance | stylet at the end | added | apical 13 | others | on the way | z | force mean / peak | norm of J "
    "| apical share | folded | failed |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|---|---|\n"
    "| | | mm | mm | mm | mm | mm | ohm | mN | ohm/mm | of JᵀJ | | |"
)


def row(late_mm: float, mode: str, found: Sequence[Outcome]) -> str:
    """Means over the insertions, with standard deviations where they tell something."""

    def told(name: str, digits: int, factor: float = 1.0) -> str:
        values = factor * np.array([getattr(o, name) for o in found])
        values = values[np.isfinite(values)]
        if not values.size:
            return "-"
        spread = f" ({values.std(ddof=1):.{digits}f})" if values.size > 1 else ""
        return f"{values.mean():.{digits}f}{spread}"

    force = f"{told('resistance_n', 0, 1e3)} / {told('peak_n', 0, 1e3)}"
    cells = [
        f"{late_mm:g} mm late" if late_mm else "on time", mode, told("stylet_mm", 2), told("offset_mm", 2),
        told("apical_mm", 3), told("basal_mm", 3), told("passage_mm", 3), told("impedance_ohm", 0), force,
        told("norm", 0), told("apical_share", 3),
        str(sum(o.folded for o in found)), str(sum(bool(o.failed) for o in found)),
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def run(count: int, jobs: int, noise_ohm: float, far_field_ohm: float, report: Callable[[str], None]) -> None:
    """Simulate and print row after row."""
    plan = plan_of(load("planar-sim", BASE))
    noise = f"backend.options.impedance.noise_ohm={noise_ohm}"
    print(HEAD)
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        for late_mm in LATE_MM:
            late = f"backend.options.phantom.stylet_late_mm={late_mm}"
            for mode, settings in MODES.items():
                report(f"{late_mm:g} mm late, {mode}")
                seeds = range(FIRST_SEED, FIRST_SEED + count)
                work = partial(insert, [*BASE, late, noise, *settings], plan, far_field_ohm=far_field_ohm)
                print(row(late_mm, mode, list(pool.map(work, seeds))), flush=True)


def fits() -> str:
    """The named designs and what is published, as a table."""
    lines = ["| design | a | b | c | R² | RMSE | std z |", "|---|---|---|---|---|---|---|"]
    rows = [(d.name, fit.fit(*d.samples())) for d in (fit.PRINTED, fit.NEAR)] + [("published", fit.PUBLISHED)]
    for name, f in rows:
        lines.append(f"| {name} | {f.factor_ohm:.2f} | {f.exponent:.4f} | {f.far_field_ohm:.1f} | {f.r2:.4f} | {f.rmse_ohm:.1f} | {f.std_ohm:.0f} |")  # fmt: skip
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=COUNT, help=f"insertions of a row [{COUNT}]")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes [all cores]")
    parser.add_argument("--noise", type=float, default=50.0, metavar="OHM", help="rms of a sample [50]")
    parser.add_argument(
        "--far-field", type=float, default=FAR_FIELD_OHM, metavar="OHM", help="what a pair shall read in a bath [c]"
    )
    parser.add_argument("--fit", action="store_true", help="fit the power law instead")
    chosen = parser.parse_args(arguments)
    if chosen.fit:
        print(fits())
    else:
        run(
            chosen.count,
            chosen.jobs,
            chosen.noise,
            chosen.far_field,
            lambda text: print(text, file=sys.stderr, flush=True),
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
