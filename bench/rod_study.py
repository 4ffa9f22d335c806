"""The array by itself: how far its results depend on their mesh, what it survives, and what it does (08 section 5).

Every insertion is by a rigid gripper along the plan, so rates and forces are those of the mechanics; what a controller
makes of them is for campaigns. Fold and buckle are bifurcations: rates over scattered runs, never single runs.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from bench.figures import Figure, Target, in_turns
from bench.rod_insertion import Case, Insertion, insert, modal_matrix, motion_of, rate, scattered_runs
from sim_backends.plant.options import Anatomy, Array, Phantom

SEED = 1
RUNS = 100
RANDOM_RUNS = 1000
ROUNDS = 5
SEGMENTS = (24, 48, 80)
STEPS_S = (2e-3, 1e-3, 5e-4)
SPEEDS_MM_PER_S = (0.5, 1.0, 2.0, 3.0)
CURVE_MM = np.arange(1.0, 13.0, 0.25)
MOST_ITERATIONS = 200
"""About a millisecond of them: a tick that needs more does not run in real time."""


def measure_mesh(case: Case | None = None) -> list[Figure]:
    """Convergence with segments and time step; cost of a tick with both, as ratios within a round."""
    part, case = "rod", case or Case()
    figures = [Figure(part, "modal model off the free shapes, rms", "rad", modal_matrix(case.array)[1])]
    meshes = {n: replace(case, array=replace(case.array, segments=n), planned=case.array) for n in SEGMENTS}
    steps = {step_s: replace(case, step_s=step_s) for step_s in STEPS_S}
    for name, cases, reference in (("segments", meshes, SEGMENTS[-1]), ("ms a step", steps, STEPS_S[-1])):
        unit = 1e3 if name == "ms a step" else 1
        runs = {value: insert(c) for value, c in cases.items()}
        best = runs[reference]
        for value, run in runs.items():
            if value != reference:
                apart = float(np.sqrt(np.mean((run.at(CURVE_MM) - best.at(CURVE_MM)) ** 2)))
                note = f"mean {run.mean_n / best.mean_n - 1:+.1%}, peak {run.peak_n / best.peak_n - 1:+.1%}"
                label = f"force curve, {unit * value:g} against {unit * reference:g} {name}, rms"
                figures.append(Figure(part, label, "N", apart, note=note))
    coarse, usual, fine = (_cost(meshes[n]) for n in SEGMENTS)
    figures += _ratios(part, "a tick with {} segments, against 48", {24: coarse, 80: fine}, usual)
    folding = _cost(replace(case, early_mm=1.0))
    return figures + _ratios(
        part, "a tick {}, against a normal one", {"with a tip that curls up before it is in": folding}, _cost(case)
    )


def measure_robustness(runs: int = RANDOM_RUNS, seed: int = SEED) -> list[Figure]:
    """Insertions drawn from the whole ranges of 08 section 4, and beyond what a surgeon would do."""
    part, random = "robustness", np.random.default_rng(seed)
    failed, worst, retries = [], [], []
    for number in range(runs):
        run = insert(random_case(random))
        worst.append(int(max(run.trace["iterations"].max(initial=0), run.rod["iterations"][0])))
        retries.append(int(run.rod["retries"][0]))
        if run.failed:
            failed.append(number)
    note = f"first of them: {failed[:5]} with seed {seed}" if failed else f"seed {seed}"
    slow = float(np.mean(np.array(worst) > MOST_ITERATIONS))
    return [
        Figure(part, f"failed of {runs} random insertions", "", float(len(failed)), target=Target(0.0), note=note),
        Figure(part, f"insertions with a tick of more than {MOST_ITERATIONS} iterations", "", slow, target=Target(0.0)),
        Figure(part, "most iterations in a tick, median insertion", "", float(np.median(worst))),
        Figure(part, "most iterations in a tick, worst insertion", "", float(np.max(worst))),
        Figure(part, "insertions with a step cut up", "", float(np.mean(np.array(retries) > 0))),
    ]


def random_case(random: np.random.Generator) -> Case:
    """Array, anatomy, tissue, errors and speed, each uniformly over its range (08 section 4)."""

    def between(low: float, high: float) -> float:
        return float(random.uniform(low, high))

    array = Array(
        segments=int(random.integers(30, 61)),
        bending_tip_nmm2=between(0.05, 0.3),
        bending_base_nmm2=between(0.5, 2.0),
        stylet_bending_nmm2=between(2.0, 8.0),
        curvature_tip_per_mm=between(0.7, 1.3),
        curvature_base_per_mm=between(0.05, 0.2),
        axial_stiffness_n=between(80.0, 500.0),
        grip_angle_rad=between(-0.02, 0.02),
    )
    friction = between(0.05, 0.5)
    tissue = Phantom(
        wall_stiffness_n_per_mm2=between(1.0, 10.0),
        friction=friction,
        friction_static=friction * between(1.0, 1.1),
        floor_load_n_per_mm=between(0.0, 0.03),
    )
    return Case(
        array=array,
        planned=Array(),
        anatomy=Anatomy(hole_radius_mm=between(0.4, 0.7), spiral_a_mm=between(3.5, 4.2)),
        tissue=tissue,
        lateral_mm=between(-1.2, 1.2),
        angle_rad=between(-0.1, 0.1),
        early_mm=between(-1.0, 1.0),
        speed_mm_per_s=float(random.choice(SPEEDS_MM_PER_S)),
        last_mm=15.0,
    )


def measure_phenomena(runs: int = RUNS, seed: int = SEED, case: Case | None = None) -> list[Figure]:
    """Folding, buckling, late stylet, no AOS, and speed, over scattered runs of each."""
    part, case = "phenomena", case or Case()
    on_time = scattered_runs(case, runs, seed)
    early = scattered_runs(replace(case, early_mm=0.5), runs, seed)
    late = scattered_runs(replace(case, early_mm=-1.0), runs, seed)
    straight = scattered_runs(replace(case, with_stylet=False), runs, seed)
    figures = [
        _share(part, "tip folds, stylet 0.5 mm early", early, "folded", Target(0.75, at_least=True)),
        _share(part, "tip folds, on time", on_time, "folded", Target(0.02)),
        _share(part, "buckles, on time", on_time, "buckled", Target(0.0)),
    ]
    aside = case.tissue.lateral_sd_mm  # the offset is the point here, so the other errors alone scatter
    for offset, target in ((0.25, Target(0.0)), (1.0, Target(1.0, at_least=True)), (1.2, Target(1.0, at_least=True))):
        for side in (1.0, -1.0):
            off = replace(case, lateral_mm=side * offset, tissue=replace(case.tissue, lateral_sd_mm=0.0))
            name = f"buckles, entry {side * offset:+g} mm off"
            figures.append(_share(part, name, scattered_runs(off, runs, seed), "buckled", target))
    figures += [
        _force(part, "mean force, on time", on_time, note=f"lateral scatter {aside:g} mm"),
        _force(part, "mean force, stylet 1 mm late, over that on time", late, on_time),
        _force(part, "mean force, no AOS, over that on time", straight, on_time),
        _force(part, "mean force, no AOS, over stylet 1 mm late", straight, late),
        Figure(part, "peak force, on time", "N", _mean(on_time, "peak_n"), note=_spread(on_time, "peak_n")),
        Figure(
            part,
            "lateral wall, stylet 1 mm late",
            "N",
            _mean(late, "lateral_wall_n"),
            _mean(on_time, "lateral_wall_n"),
            "on time",
        ),
    ]
    return figures + _speeds(part, case, runs // 5, seed)


def _speeds(part: str, case: Case, runs: int, seed: int) -> list[Figure]:
    """Work of an insertion at each speed over that at 1 mm/s, run by run."""
    work = {
        v: np.array([r.work_nmm for r in scattered_runs(replace(case, speed_mm_per_s=v), runs, seed)])
        for v in SPEEDS_MM_PER_S
    }
    figures = []
    for speed in SPEEDS_MM_PER_S:
        low, middle, high = (float(q) for q in np.percentile(work[speed] / work[1.0], (25, 50, 75)))
        target = Target(1.0, at_least=True) if speed < 1.0 else Target(1.02) if speed > 1.0 else None
        name, ours, usual = f"work at {speed:g} mm/s", float(work[speed].mean()), float(work[1.0].mean())
        figures.append(Figure(part, name, "N mm", ours, usual, "1 mm/s", middle, (low, high), target))
    return figures


def _share(part: str, name: str, runs: Sequence[Insertion], what: str, target: Target | None) -> Figure:
    aside = f"{len(runs)} runs; stuck {rate(runs, 'stuck'):.0%}, failed {rate(runs, 'failed'):.0%}"
    return Figure(part, name, "", rate(runs, what), target=target, note=aside)


def _force(
    part: str, name: str, runs: Sequence[Insertion], others: Sequence[Insertion] | None = None, note: str = ""
) -> Figure:
    """Mean insertion forces, or their ratio to those of others with the same scatter, run by run."""
    if others is None:
        return Figure(part, name, "N", _mean(runs, "mean_n"), note=f"{_spread(runs, 'mean_n')}; {note}")
    ratios = [a.mean_n / b.mean_n for a, b in zip(runs, others, strict=True)]
    low, middle, high = (float(q) for q in np.percentile(ratios, (25, 50, 75)))
    target = Target(1.0, at_least=True)
    return Figure(
        part, name, "N", _mean(runs, "mean_n"), _mean(others, "mean_n"), "the same runs", middle, (low, high), target
    )


def _mean(runs: Sequence[Insertion], what: str) -> float:
    return float(np.mean([getattr(run, what) for run in runs]))


def _spread(runs: Sequence[Insertion], what: str) -> str:
    return f"sd {np.std([getattr(run, what) for run in runs]):.3f}"


def _cost(case: Case) -> Callable[[], float]:
    """Cost of a tick of a case [us], plan apart."""
    motion_of(case)
    return lambda: insert(case).us_per_tick


def _ratios(
    part: str,
    name: str,
    costs: dict[int, Callable[[], float]] | dict[str, Callable[[], float]],
    usual: Callable[[], float],
) -> list[Figure]:
    times = in_turns(ROUNDS, *costs.values(), usual)
    figures = []
    for key, ours in zip(costs, times, strict=False):
        low, middle, high = (float(q) for q in np.percentile(np.array(ours) / np.array(times[-1]), (25, 50, 75)))
        mine, reference = float(np.median(ours)), float(np.median(times[-1]))
        figures.append(Figure(part, name.format(key), "us", mine, reference, "", middle, (low, high)))
    return figures
