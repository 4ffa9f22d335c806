"""A detector trained once on SYN-1, which the tests of everything around it share."""

import json

import pytest

from rtctl.guidance import detector_file, training
from rtctl.guidance.dataset import synthesise


@pytest.fixture(scope="session")
def detector():
    return training.train(synthesise(0, 51, 56), reference_forces=True)


@pytest.fixture(scope="session")
def table(detector):
    """The content of its file, as it comes back from it; not to be changed."""
    return json.loads(json.dumps(detector_file.to_table(detector)))
