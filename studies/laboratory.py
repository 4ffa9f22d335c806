"""Insertions with many settings in the same processes, for fits: starting processes takes longer than an insertion."""

import os
from collections.abc import Hashable, Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

from rtctl.electrode.planning import Plan
from rtctl.planner import plan_of
from rtctl.settings import load
from rtctl.study.insertions import Insertions, insert


class Laboratory:
    """Runs insertions with settings on top of `planar-sim`, in as many processes as there are cores."""

    def __init__(self, jobs: int | None = None) -> None:
        self._pool = ProcessPoolExecutor(jobs or os.cpu_count() or 1, get_context("spawn"))
        self._plans: dict[Hashable, Plan] = {}

    def insert(self, overrides: Iterable[str], seeds: Iterable[int]) -> Insertions:
        """One insertion for every seed."""
        settings = load("planar-sim", overrides)
        models = settings.electrode, settings.cochlea
        if models not in self._plans:
            self._plans[models] = plan_of(settings)
        return Insertions(self._pool.map(partial(insert, settings, self._plans[models]), seeds))

    def close(self) -> None:
        """End the processes."""
        self._pool.shutdown(cancel_futures=True)
