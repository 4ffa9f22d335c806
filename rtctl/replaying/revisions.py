"""Other revisions of rtctl: their working copies in a temporary folder, and the outputs they give for a log's inputs."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hal.errors import RtctlError
from hal.kernel import ROOT
from rtctl.log.reader import Log
from rtctl.parameters import with_values
from rtctl.replay import whole_rows
from rtctl.settings import from_table, public_table

ELSEWHERE = Path(__file__).with_name("elsewhere.py")


class RevisionError(RtctlError):
    """A revision cannot be found, or cannot replay the log."""


@dataclass(frozen=True)
class Outputs:
    """What a revision made of the inputs: records (n,) in its own layout, and the files that shape its arithmetic."""

    rows: np.ndarray
    kernel_hash: str
    kernel_sources: tuple[str, ...]


@dataclass
class Revisions:
    """The clone rtctl runs from, seen from a temporary folder; made by :func:`revisions`.

    The user's working copy is never touched: every revision gets one of its own, and a kernel cache.
    """

    clone: Path
    folder: Path
    cache: Path
    """where their kernels are compiled to"""
    _folders: dict[str, Path] = field(default_factory=dict)

    def resolve(self, name: str) -> str:
        """The full number of a commit. Raises RevisionError if there is none of that name."""
        try:
            return self._git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{name}^{{commit}}").strip()
        except subprocess.CalledProcessError:
            raise RevisionError("there is no such revision", value=name, remedy="give a commit, branch or tag of this clone") from None  # fmt: skip

    def subject(self, commit: str) -> str:
        """Short number and first line of a commit."""
        return self._git("show", "-s", "--format=%h %s", commit).strip()

    def touching(self, good: str, bad: str, files: Sequence[str]) -> list[str]:
        """First-parent commits after `good` up to `bad` that touch one of `files`, the oldest first."""
        listed = self._git("rev-list", "--first-parent", "--reverse", f"{good}..{bad}", "--", *files)
        return listed.split()

    def is_ancestor(self, good: str, bad: str) -> bool:
        """Whether `good` is in the history of `bad`."""
        command = ["git", "-C", str(self.clone), "merge-base", "--is-ancestor", good, bad]
        return subprocess.run(command, check=False, capture_output=True).returncode == 0

    def outputs(self, commit: str, log: Log, ticks: int | None = None) -> Outputs:
        """What `commit` makes of the first `ticks` rows of a log, of all of them by default.

        Raises:
            RevisionError: that revision cannot read the log, or does not run.
        """
        folder = self._checked_out(commit)
        table = public_table(from_table(log.settings_table()))
        job = {
            "settings": table, "chosen": _chosen(table, public_table(from_table({}))), "revision_folder": str(folder),
            "staged_plan": log.plans, "staged_parameters": [_whole(table, message) for message in log.parameters],
        }  # fmt: skip
        with tempfile.TemporaryDirectory(dir=self.folder) as place:
            work = Path(place)
            (work / "job.json").write_text(json.dumps(job))
            np.save(work / "rows.npy", whole_rows(log)[:ticks])
            environment = os.environ | {"PYTHONPATH": str(folder), "RTCTL_CACHE_DIR": str(self.cache)}
            command = [sys.executable, "-P", str(ELSEWHERE), str(work)]
            done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                told = work / "refused.txt"
                why = told.read_text() if told.exists() else done.stderr.strip()[-500:]
                raise RevisionError(f"revision {commit[:12]} cannot replay this log: {why}", remedy="take a later revision, or a log of its time")  # fmt: skip
            facts = json.loads((work / "told.json").read_text())
            return Outputs(np.load(work / "replayed.npy"), facts["kernel_hash"], tuple(facts["kernel_sources"]))

    def _checked_out(self, commit: str) -> Path:
        if commit not in self._folders:
            target = self.folder / commit[:12]
            self._git("worktree", "add", "--detach", "--quiet", str(target), commit)
            self._folders[commit] = target
        return self._folders[commit]

    def close(self) -> None:
        """Take the working copies away again."""
        for folder in self._folders.values():
            self._git("worktree", "remove", "--force", str(folder))

    def _git(self, *words: str) -> str:
        command = ["git", "-C", str(self.clone), *words]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout


@contextmanager
def revisions(clone: Path = ROOT) -> Iterator[Revisions]:
    """Access to the other revisions of the clone at `clone`, by default the one we run from.

    Raises:
        RevisionError: it is no git clone, or there is no git.
    """
    if not (clone / ".git").exists():
        raise RevisionError("rtctl does not run from a git clone, so there are no other revisions", value=str(clone), remedy="clone the repository, `make`, and use its .venv/bin/rtctl")  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="rtctl-revisions-") as folder:
        found = Revisions(clone, Path(folder), Path(folder, "cache"))
        try:
            yield found
        except FileNotFoundError as error:
            if error.filename != "git":
                raise
            raise RevisionError("there is no git on this machine", remedy="install git") from None
        except subprocess.CalledProcessError as error:
            raise RevisionError(f"git failed: {error.stderr.strip()}", value=" ".join(error.cmd[3:])) from None
        finally:
            found.close()


def _chosen(table: dict[str, Any], defaults: dict[str, Any]) -> dict[str, Any]:
    """The part of a settings table that is not as by default."""
    found: dict[str, Any] = {}
    for name, value in table.items():
        default = defaults.get(name)
        if isinstance(value, dict) and isinstance(default, dict):
            if inner := _chosen(value, default):
                found[name] = inner
        elif value != default:
            found[name] = value
    return found


def _whole(table: dict[str, Any], message: dict[str, Any]) -> dict[str, Any]:
    """A message on a parameter set with all settings it stands for, for a revision that packs them otherwise."""
    return message | ({"settings": with_values(table, message["values"])} if "values" in message else {})
