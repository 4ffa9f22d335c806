"""A trained detector as a data file: what it looks for, everything it needs for that, and where it comes from.

JSON, so that it can be read, compared and kept. Nothing in it is taken on trust: another version, other features, another
grid, a wrong shape or a number that is not finite is refused.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hal.errors import OptionError, RtctlError
from hal.options import option, read, table_of
from rtctl.guidance.buckling import BucklingModel
from rtctl.guidance.features import FEATURE_EVERY, FEATURE_SAMPLES, SAMPLES, Standard
from rtctl.guidance.folding import CHANNEL_COUNTS, KNOWN, FoldModel
from rtctl.guidance.force_model import CHANNELS, FULL_DEPTH_MM, ORDER, ForceModel
from rtctl.guidance.prediction import LENGTH, rate_deviation

FORMAT, VERSION, KIND = "rtctl-detector", 1, "linear-svm"


class DetectorError(RtctlError):
    """A detector cannot be read, or is not one for this version of rtctl."""

    exit_code = 2


@dataclass(frozen=True)
class Grid:
    """Where an insertion is sampled."""

    samples: int = option(doc="samples of a profile, from lambda = 0 to 1")
    feature_every: int = option(doc="every so many samples one is a feature")
    full_depth_mm: float = option(unit="mm", doc="depth of lambda = 1")
    channels: list = option(doc="channels of a profile, in their order")


@dataclass(frozen=True)
class Forces:
    """The force model that predicts the rest of an insertion (03 sections 1 and 2)."""

    source: str = option(doc="where the curves come from")
    length: float = option(low=0.01, high=1.0, doc="l: correlation length of an insertion's forces [lambda]")
    floor: tuple[float, ...] = option(shape=(3,), low=1e-6, high=100.0, unit="N, N mm", doc="beta of each channel")
    mean: tuple[tuple[float, ...], ...] = option(shape=(3, ORDER + 1), low=-1e6, high=1e6, unit="N, N mm", doc="Bernstein coefficients of the mean")  # fmt: skip
    deviation: tuple[tuple[float, ...], ...] = option(shape=(3, ORDER + 1), low=-1e6, high=1e6, unit="N, N mm", doc="Bernstein coefficients of the standard deviation")  # fmt: skip


@dataclass(frozen=True)
class Folding:
    """The classifier of tip folding (03 sections 5 and 6)."""

    method: int = option(low=1, high=2, doc="1: features of f_z; 2: of f_z, f_xx and f_yy")
    o: tuple[float, ...] = option(shape=(-1,), low=-1e6, high=1e6, unit="N, N mm", doc="mean of each feature")
    S: tuple[float, ...] = option(shape=(-1,), low=1e-12, high=1e6, unit="N, N mm", doc="deviation of each feature")
    w: tuple[float, ...] = option(shape=(-1,), low=-1e6, high=1e6, doc="weight of each standardised feature")
    b: float = option(low=-1e6, high=1e6, doc="bias; normal is h >= 0")
    known: list = option(doc="numbers of known samples at which it decides")
    bound: tuple[float, ...] = option(shape=(len(KNOWN),), low=0.0, high=1e6, doc="delta h at each of them, before rho")


@dataclass(frozen=True)
class Buckling:
    """Normal values of the two integrals at every sample (03 section 4)."""

    mean: tuple[tuple[float, ...], ...] = option(shape=(2, SAMPLES), low=-1e6, high=1e6, unit="N, N mm", doc="phi_1, phi_2")  # fmt: skip
    deviation: tuple[tuple[float, ...], ...] = option(shape=(2, SAMPLES), low=0.0, high=1e6, unit="N, N mm", doc="their standard deviations")  # fmt: skip


@dataclass(frozen=True)
class File:
    """The whole file."""

    grid: Grid
    forces: Forces
    folding: Folding
    buckling: Buckling
    format: str = option(choices=(FORMAT,), doc="what the file is")
    version: int = option(low=VERSION, high=VERSION, doc="of the format")
    kind: str = option(choices=(KIND,), doc="of the classifier")
    provenance: dict = option(doc="data, seed, counts, date and revision; told, never used")


@dataclass(frozen=True)
class Detector:
    """A detector ready for use: what predicts, what classifies folds, what is normal for the integrals."""

    forces: ForceModel
    folding: FoldModel
    buckling: BucklingModel
    provenance: dict[str, Any]


def load(path: str | Path) -> Detector:
    """The detector in a file.

    Raises:
        DetectorError: see :func:`from_table`, or the file cannot be read.
    """
    return from_table(read_table(path))


def read_table(path: str | Path) -> dict[str, Any]:
    """The content of a file, unchecked. Raises DetectorError if it cannot be read or is no JSON table."""
    file = Path(path)
    try:
        table = json.loads(file.read_text())
    except OSError as error:
        raise DetectorError("the detector cannot be read", value=str(path), remedy=f"{error.strerror}; make one with `rtctl detector train`") from None  # fmt: skip
    except (ValueError, RecursionError) as error:
        raise DetectorError(f"{path} is no detector: it is not JSON", value=str(error), remedy="make one with `rtctl detector train`") from None  # fmt: skip
    if not isinstance(table, dict):
        raise DetectorError(f"{path} is no detector", value=type(table).__name__, bound="a JSON table")
    return table


def from_table(table: dict[str, Any]) -> Detector:
    """A detector from the content of its file, checked from end to end.

    Raises:
        DetectorError: another format, version, kind, features or grid; a wrong shape; a number that is not finite.
    """
    try:
        file = read(File, table)
    except OptionError as error:
        raise DetectorError(f"this is no detector for this version of rtctl: {error.what}", value=_short(error.value), bound=error.bound, remedy="train it anew with `rtctl detector train`") from None  # fmt: skip
    channels = CHANNEL_COUNTS[file.folding.method]
    dimension = channels * len(FEATURE_SAMPLES)
    _agree("grid.samples", file.grid.samples, SAMPLES)
    _agree("grid.feature_every", file.grid.feature_every, FEATURE_EVERY)
    _agree("grid.full_depth_mm", file.grid.full_depth_mm, FULL_DEPTH_MM)
    _agree("grid.channels", file.grid.channels, list(CHANNELS))
    _agree("forces.length", file.forces.length, LENGTH)
    _agree("folding.known", file.folding.known, KNOWN.tolist())
    for name in ("o", "S", "w"):
        _agree(f"number of features in folding.{name}", len(getattr(file.folding, name)), dimension)
    forces = ForceModel(np.array(file.forces.mean), np.array(file.forces.deviation), np.array(file.forces.floor))
    if (rate_deviation(forces, np.linspace(0.0, 1.0, SAMPLES)) <= 0.0).any():
        raise DetectorError("the detector's forces have no deviation somewhere", bound="above 0", remedy="train it on more insertions")  # fmt: skip
    standard = Standard(np.array(file.folding.o), np.array(file.folding.S))
    return Detector(
        forces,
        FoldModel(
            file.folding.method, standard, np.array(file.folding.w), file.folding.b, np.array(file.folding.bound)
        ),
        BucklingModel(np.array(file.buckling.mean), np.array(file.buckling.deviation)),
        file.provenance,
    )


def to_table(detector: Detector) -> dict[str, Any]:
    """The inverse of :func:`from_table`."""
    folding, forces = detector.folding, detector.forces
    return {
        "format": FORMAT,
        "version": VERSION,
        "kind": KIND,
        "provenance": detector.provenance,
        "grid": table_of(Grid(SAMPLES, FEATURE_EVERY, FULL_DEPTH_MM, list(CHANNELS))),
        "forces": {
            "source": str(detector.provenance.get("forces", "")),
            "length": LENGTH,
            "floor": forces.floor.tolist(),
            "mean": forces.mean.tolist(),
            "deviation": forces.deviation.tolist(),
        },
        "folding": {
            "method": folding.method,
            "o": folding.standard.mean.tolist(),
            "S": folding.standard.deviation.tolist(),
            "w": folding.weight.tolist(),
            "b": folding.bias,
            "known": KNOWN.tolist(),
            "bound": folding.bound.tolist(),
        },
        "buckling": {
            "mean": detector.buckling.mean.tolist(),
            "deviation": detector.buckling.deviation.tolist(),
        },
    }


def write(detector: Detector, path: Path) -> None:
    """Put the detector into a file. Raises DetectorError if it cannot be written."""
    try:
        path.write_text(json.dumps(to_table(detector), indent=1) + "\n")
    except OSError as error:
        raise DetectorError("the detector cannot be written", value=str(path), remedy=str(error.strerror)) from None


def _agree(name: str, found: Any, wanted: Any) -> None:
    if found != wanted:
        raise DetectorError(f"the detector was trained on other features: {name}", value=_short(found), bound=_short(wanted), remedy="train it anew with `rtctl detector train`")  # fmt: skip


def _short(value: Any) -> Any:
    """A value as it may stand in a message."""
    text = str(value)
    return f"{text[:60]} ..." if len(text) > 64 else value
