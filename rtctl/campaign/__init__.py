"""Many insertions, one after the other or side by side, and one table of their figures: ``rtctl sim --count``.

Each row depends on the settings and its seed alone: not on how many run at a time, and not on whether the table was
begun today. The table is the only state there is, so a campaign goes on wherever it was ended.
"""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from hal.backend import drawn_values
from hal.kernel import kernel_hash
from rtctl.campaign.row import columns, is_failure, row_of
from rtctl.campaign.table import Table
from rtctl.campaign.workers import results_of
from rtctl.lockstep import Lockstep
from rtctl.planner import plan_of
from rtctl.settings import Settings, config_hash


@dataclass(frozen=True)
class Standing:
    """Where a campaign is: rows in the table of those asked for, how many of them tell of a failure."""

    done: int
    total: int
    failed: int


def run(
    settings: Settings,
    seeds: range,
    file: Path,
    jobs: int = 1,
    report: Callable[[Standing], None] = lambda _: None,
    logs: Path | None = None,
) -> Standing:
    """Simulate the insertion once for each of `seeds` that is not in the table yet, and append its row.

    Args:
        file: the table, CSV; it is made, or goes on if it was begun with the same settings and kernels.
        jobs: processes to use.
        report: is told where the campaign is, before the first run and after each.
        logs: folder to write the log of every run to, as SEED.mcap; rows that are there already get none.

    Raises:
        CampaignError: the file cannot be written, or holds something else; a process was killed.
        RtctlError: the settings are wrong, or the backend cannot run in lockstep: nothing was written.
    """
    trial = Lockstep(settings, seeds[0])  # compiles, once for all processes, and finds what is wrong with every run
    trial.close()
    names = columns(tuple(drawn_values(trial.backend)))
    identity = {"config_hash": config_hash(settings), "kernel_hash": kernel_hash()}
    with Table(file, names, identity) as table:
        failed = sum(is_failure(table.known[seed]) for seed in seeds if seed in table.known)
        if logs is not None:
            logs.mkdir(parents=True, exist_ok=True)
        missing = [seed for seed in seeds if seed not in table.known]
        done = len(seeds) - len(missing)
        report(Standing(done, len(seeds), failed))
        simulated = partial(row_of, settings, logs=logs, plan=plan_of(settings) if missing else None)
        with closing(results_of(simulated, missing, jobs)) as rows:
            for row in rows:
                table.append(row)
                done, failed = done + 1, failed + is_failure(row)
                report(Standing(done, len(seeds), failed))
    return Standing(done, len(seeds), failed)
