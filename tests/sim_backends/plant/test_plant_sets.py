"""Spec 08 section 5, item 9: forces of the two sets that the plant was fitted to, within their bands (Table VI.3)."""

import numpy as np
import pytest

from sim_backends.plant.options import Bone, Phantom
from studies import fit_plant
from studies.laboratory import Laboratory


@pytest.fixture(scope="module")
def laboratory():
    laboratory = Laboratory()
    yield laboratory
    laboratory.close()


@pytest.mark.parametrize(("specimen", "kind"), [("phantom", Phantom), ("bone", Bone)])
def test_forces_without_control_are_within_the_bands(laboratory, specimen, kind):
    values = {name: getattr(kind(), name) for name in ("friction", "stylet_late_mm")}
    insertions = laboratory.insert(fit_plant.overrides(specimen, values), fit_plant.SEEDS[specimen])
    assert not insertions.ended_early.any()
    assert not insertions.folded.any()
    found = fit_plant.figures(insertions)
    for name, (value, band) in fit_plant.TARGETS[specimen].items():
        assert found[name] == pytest.approx(value, abs=band), name
    if specimen == "phantom":  # section 3: the early force comes from floor and lid
        z = fit_plant.against_table(insertions)
        assert np.mean(np.abs(z) <= 1.0) > 0.8
