"""Work on all cores: processes that take one item after the other; results come in the order of the items."""

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from typing import Any, TypeVar

from rtctl.campaign.table import CampaignError

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Libraries read these when they are loaded; processes side by side are enough, their threads would only wait."""

Item = TypeVar("Item")
Result = TypeVar("Result")

_function: Callable[[Any], Any] | None = None
"""What a worker does with each item."""


def results_of(function: Callable[[Item], Result], items: Iterable[Item], jobs: int) -> Generator[Result, None, None]:
    """function(item) of every item, in order, with `jobs` processes; close it to end the processes.

    The first is computed here in any case: it compiles what is missing, so that the workers only load.

    Raises:
        CampaignError: a worker was killed.
    """
    todo = list(items)
    here = todo if jobs == 1 else todo[:1]
    for item in here:
        yield function(item)
    if len(here) < len(todo):
        yield from _side_by_side(function, todo[len(here) :], jobs)


def _side_by_side(function: Callable[[Item], Result], items: list[Item], jobs: int) -> Generator[Result, None, None]:
    others = set(active_children())
    pool = ProcessPoolExecutor(min(jobs, len(items)), get_context("spawn"), _begin, (function,))
    with _one_thread_each(), pool:
        try:
            # not pool.map: it cancels what is left, and a pool whose processes are ended then trips over that
            for future in [pool.submit(_run, item) for item in items]:
                yield future.result()
        except BrokenProcessPool:
            raise CampaignError("a process of the campaign was killed", remedy="run the same command again, with fewer --jobs if memory was short") from None  # fmt: skip
        except BaseException:  # Ctrl-C, or the rest is not wanted: do not wait for runs under way
            for process in set(active_children()) - others:
                process.terminate()
            raise


def _begin(function: Callable[[Any], Any]) -> None:
    """Start of a worker: Ctrl-C is for its parent to see, and without a parent it ends."""
    global _function
    _function = function
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _run(item: Any) -> Any:
    assert _function is not None
    return _function(item)


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
