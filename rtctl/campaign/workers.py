"""The processes of a campaign: each runs one insertion after the other; rows come in the order of the seeds."""

import os
import signal
import threading
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process

from rtctl.campaign.row import Row, row_of
from rtctl.campaign.table import CampaignError
from rtctl.electrode.planning import Plan
from rtctl.settings import Settings

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Libraries read these when they are loaded; processes side by side are enough, their threads would only wait."""

_shared: tuple[Settings, Plan | None] | None = None
"""What every run of a worker needs."""


def rows_of(settings: Settings, seeds: Iterable[int], plan: Plan | None, jobs: int) -> Generator[Row, None, None]:
    """The rows of `seeds`, in order, with `jobs` processes; close it to end the processes.

    The first is computed here in any case: it compiles what is missing, so that the workers only load.

    Raises:
        CampaignError: a worker was killed.
    """
    todo = list(seeds)
    here = todo if jobs == 1 else todo[:1]
    for seed in here:
        yield row_of(settings, seed, plan)
    if len(here) < len(todo):
        yield from _side_by_side(settings, todo[len(here) :], plan, jobs)


def _side_by_side(settings: Settings, seeds: list[int], plan: Plan | None, jobs: int) -> Generator[Row, None, None]:
    others = set(active_children())
    pool = ProcessPoolExecutor(min(jobs, len(seeds)), get_context("spawn"), _begin, (settings, plan))
    with _one_thread_each(), pool:
        try:
            # not pool.map: it cancels what is left, and a pool whose processes are ended then trips over that
            for future in [pool.submit(_run, seed) for seed in seeds]:
                yield future.result()
        except BrokenProcessPool:
            raise CampaignError("a process of the campaign was killed", remedy="run the same command again, with fewer --jobs if memory was short") from None  # fmt: skip
        except BaseException:  # Ctrl-C, or the rest is not wanted: do not wait for runs under way
            for process in set(active_children()) - others:
                process.terminate()
            raise


def _begin(settings: Settings, plan: Plan | None) -> None:
    """Start of a worker: Ctrl-C is for its parent to see, and without a parent it ends."""
    global _shared
    _shared = settings, plan
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _run(seed: int) -> Row:
    assert _shared is not None
    settings, plan = _shared
    return row_of(settings, seed, plan)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started inside have one thread for numbers."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
