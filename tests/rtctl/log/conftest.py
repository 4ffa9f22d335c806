from collections.abc import Callable

import numpy as np
import pytest

from hal.signals import TICK, TIME, Signal, Table
from rtctl.record import controller_table

MakeRows = Callable[..., np.ndarray]


def random_rows(table: Table, count: int, *, first_tick: int = 0, seed: int = 0) -> np.ndarray:
    """Consecutive ticks at 1 kHz; every other field holds random bits of its type, NaN and infinity included."""
    rng = np.random.default_rng(seed)
    rows = np.frombuffer(rng.bytes(count * table.dtype.itemsize), table.dtype).copy()
    rows["tick"] = np.arange(first_tick, first_tick + count)
    rows["time_ns"] = rows["tick"] * 1_000_000
    rows["missed_ticks"] = 0
    return rows


@pytest.fixture(scope="session")
def make_rows() -> MakeRows:
    return random_rows


@pytest.fixture
def table() -> Table:
    return controller_table(3)


@pytest.fixture(scope="session")
def small_table() -> Table:
    """Few bytes a row, so that a file of several chunks stays small; with padding at the end."""
    return Table(
        "Controller",
        (
            TIME,
            TICK,
            Signal("pose", "f8", (2,), "mm", "an output"),
            Signal("missed_ticks", "i4", (), "ticks", "an input"),
            Signal("motion", "u1", (), "", "an output"),
        ),
    )
