"""One short simulated insertion, which the tests of what is made of a run share."""

from pathlib import Path
from typing import NamedTuple

import pytest

from rtctl.settings import Settings, load
from rtctl.simulation import Simulation, simulate

SHORT = ("workflow.depth_mm=4.0", "workflow.hold_s=0.1")
SEED = 3


class Insertion(NamedTuple):
    """A simulated run and the log it left."""

    settings: Settings
    simulation: Simulation
    log: Path
    steps: list[str]


@pytest.fixture(scope="session")
def insertion(tmp_path_factory: pytest.TempPathFactory) -> Insertion:
    """Four millimetres with the shipped settings."""
    settings, steps = load("planar-sim", SHORT), []
    log = tmp_path_factory.mktemp("insertion") / "log.mcap"

    def note(progress):
        if progress.name not in steps:
            steps.append(progress.name)

    return Insertion(settings, simulate(settings, SEED, log=log, report=note), log, steps)
