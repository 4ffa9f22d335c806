"""Insertions to train and to judge detectors with: from logs, or made up (SYN-1).

Each is a profile of 97 forces at equal distances over the depth, taken from a log at the very ticks at which the detectors
would take them, and a class: what happened, as the simulation knew it or as somebody wrote it down.
"""

import csv
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rtctl import robots
from rtctl.guidance import synthetic
from rtctl.guidance.features import GRID
from rtctl.guidance.force_model import FULL_DEPTH_MM
from rtctl.guidance.svm import TrainingError
from rtctl.guidance.watch import OUTSIDE_MM
from rtctl.lifecycle import Task
from rtctl.recording import Recording, logs_in, open_recording
from rtctl.wrench import into_sensor

NORMAL, FOLD, BUCKLE = "normal", "fold", "buckle"
CLASSES = (NORMAL, FOLD, BUCKLE)
LABELS_FILE = "labels.csv"
"""Beside logs that do not know what happened: columns file, class."""


@dataclass(frozen=True)
class Dataset:
    """Insertions.

    Attributes:
        profiles: f_z [N], f_xx, f_yy [N mm] at `GRID`, (n, 3, 97).
        classes: what happened to each (n,), one of `CLASSES`.
        name: what they are, in a few words.
        digest: of the profiles and classes.
        skipped: insertions that could not be used, and why.
    """

    profiles: np.ndarray
    classes: np.ndarray
    name: str
    skipped: tuple[str, ...] = ()

    @property
    def digest(self) -> str:
        """Sixteen hex digits of what is in it."""
        return hashlib.sha256(self.profiles.tobytes() + ",".join(self.classes.tolist()).encode()).hexdigest()[:16]

    def of(self, name: str) -> np.ndarray:
        """Profiles of one class."""
        return self.profiles[self.classes == name]

    def counts(self) -> dict[str, int]:
        """How many there are of each class."""
        return {name: int((self.classes == name).sum()) for name in CLASSES}


def synthesise(seed: int, normal: int, fold: int, buckle: int = 0) -> Dataset:
    """So many insertions of SYN-1, from a seed."""
    random = np.random.default_rng(seed)
    profiles = [synthetic.normal(normal, random), synthetic.folding(fold, random)]
    profiles.append(synthetic.buckling(buckle, random)[0])
    classes = np.repeat(np.array(CLASSES), (normal, fold, buckle))
    return Dataset(np.concatenate(profiles), classes, f"{synthetic.NAME} (simulated), seed {seed}")


def collect(folders: Sequence[Path]) -> Dataset:
    """The insertions in folders of logs: each ``*.mcap`` is one, and so is each folder of a run with its ``log*.mcap``.

    Raises:
        TrainingError: there is no insertion that could be used, or one of which nobody knows what happened.
        LogError: a log cannot be read.
    """
    profiles, classes, skipped = [], [], []
    for folder in folders:
        labels = _labels(folder / LABELS_FILE)
        for name, logs in _runs(folder):
            recording = open_recording(logs)
            found = profile(recording)
            if isinstance(found, str):
                skipped.append(f"{name}: {found}")
                continue
            forces, last = found
            profiles.append(forces)
            classes.append(_class(recording, last, labels.get(name), folder / name))
    if not profiles:
        raise TrainingError("no log holds a whole insertion", value=[str(f) for f in folders], bound=f"{FULL_DEPTH_MM} mm deep", remedy="; ".join(skipped[:3]) or "give folders of *.mcap")  # fmt: skip
    name = f"logs in {', '.join(folder.name or str(folder) for folder in folders)}"
    return Dataset(np.array(profiles), np.array(classes), name, tuple(skipped))


def profile(recording: Recording) -> tuple[np.ndarray, int] | str:
    """Profile (3, 97) of a recorded insertion and the row of its last sample; or why it has none.

    A sample is taken in the tick after the one in which the commanded depth reached it, as in the tick itself.
    """
    rows = recording.records
    inserting, depth = rows["task_state"][:-1] == Task.INSERTING, rows["depth_mm"][:-1]
    felt = np.isfinite(rows["force_axial_n"][1:]) & np.isfinite(rows["wrench_in_base"][1:]).all(axis=1)
    usable = np.flatnonzero(inserting & (depth > OUTSIDE_MM) & felt)
    if not len(usable):
        return "nothing was inserted with a known force"
    attempt = np.cumsum(depth <= OUTSIDE_MM)[usable]  # after a whole retraction everything begins anew
    usable = usable[attempt == attempt[depth[usable].argmax()]]
    way = np.maximum.accumulate(depth[usable])
    wanted = GRID * FULL_DEPTH_MM
    at = np.searchsorted(way, wanted)
    if at[-1] == len(usable):
        return f"it ended at {way[-1]:.1f} mm, before {FULL_DEPTH_MM} mm"
    late = way[at] >= np.append(wanted[1:], np.inf)
    if late.any():
        return f"no force is known from {wanted[late][0]:.2f} mm on"
    chosen = usable[at] + 1
    return _forces(recording, chosen), int(chosen[-1])


def _forces(recording: Recording, chosen: np.ndarray) -> np.ndarray:
    """f_z, f_xx, f_yy (3, k) of some rows; the moments turned back into {F}."""
    robot = robots.load(recording.settings.robot.kind, recording.settings.robot.geometry)
    forces, moment = np.zeros((3, len(chosen))), np.zeros(3)
    for i, row in enumerate(recording.records[chosen]):
        into_sensor(robot.rotation(row["pose_measured"]), np.array(row["wrench_in_base"][3:]), moment)
        forces[:, i] = row["force_axial_n"], moment[0], moment[1]
    return forces


def _runs(folder: Path) -> list[tuple[str, list[Path]]]:
    """Name and log files of every insertion in a folder."""
    single = [(file.name, [file]) for file in sorted(folder.glob("*.mcap"))]
    runs = [(inner.name, logs_in(inner)) for inner in sorted(folder.glob("*/"))]
    return single + [(name, logs) for name, logs in runs if logs]


def _labels(file: Path) -> dict[str, str]:
    """Classes somebody wrote down: name of a log, or of a run's folder -> class."""
    if not file.exists():
        return {}
    try:
        with file.open(newline="") as text:
            labels = {row["file"]: row["class"] for row in csv.DictReader(text)}
    except (OSError, KeyError, csv.Error) as error:
        raise TrainingError("the labels cannot be read", value=str(file), bound="columns file and class", remedy=str(error)) from None  # fmt: skip
    for name, label in labels.items():
        if label not in CLASSES:
            raise TrainingError(f"{file}: {name} has no class that is known", value=label, bound=" | ".join(CLASSES))
    return labels


def _class(recording: Recording, last: int, written: str | None, path: Path) -> str:
    """What happened up to the last sample: what was written down, else what the simulation knew."""
    if written is not None:
        return written
    truths = recording.truths
    if truths is None or not {"folded", "buckled"} <= set(truths.dtype.names or ()):
        raise TrainingError("nobody knows what happened in this insertion", value=str(path), remedy=f"write it into {LABELS_FILE} beside it: file,class")  # fmt: skip
    at = int(np.searchsorted(truths["tick"], recording.records["tick"][last], side="right")) - 1
    truth = truths[max(at, 0)]
    return FOLD if truth["folded"] else BUCKLE if truth["buckled"] else NORMAL
