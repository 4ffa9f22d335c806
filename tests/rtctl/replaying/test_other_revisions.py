"""Other revisions: found in the clone, run in a process of their own, and the first that differs found among many."""

import subprocess
import sys
from pathlib import Path

import pytest

from hal.kernel import ROOT, cache_directory, kernel_hash
from rtctl.log.reader import Log
from rtctl.replaying import elsewhere
from rtctl.replaying.against import bisect, compare, here
from rtctl.replaying.revisions import Outputs, RevisionError, Revisions, revisions
from rtctl.settings import Settings

GOLDEN = Path(__file__).parents[1] / "golden"


@pytest.fixture(scope="module")
def log():
    return Log.open(GOLDEN / "operation.mcap")


@pytest.fixture
def clone(tmp_path):
    """A clone with four commits; `kernel.py` is touched by the second and the fourth."""

    def git(*words):
        command = ["git", "-c", "user.name=t", "-c", "user.email=t@t", "-C", str(tmp_path / "clone"), *words]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    (tmp_path / "clone").mkdir()
    git("init", "--quiet")
    commits = []
    for n, name in enumerate(("readme", "kernel.py", "readme", "kernel.py")):
        (tmp_path / "clone" / name).write_text(f"{n}\n")
        git("add", ".")
        git("commit", "--quiet", "-m", f"commit {n}")
        commits.append(git("rev-parse", "HEAD"))
    return tmp_path / "clone", commits


def test_revisions_are_found_and_taken_away_again(clone):
    folder, commits = clone
    with revisions(folder) as found:
        assert found.resolve("HEAD~2") == commits[1]
        assert found.subject(commits[1]).endswith("commit 1")
        assert found.touching(commits[0], commits[3], ["kernel.py"]) == [commits[1], commits[3]]
        assert found.is_ancestor(commits[0], commits[3])
        assert not found.is_ancestor(commits[3], commits[0])
        other = found._checked_out(commits[0])
        assert (other / "readme").read_text() == "0\n"
        for name in ("no-such-revision", "--all", "HEAD:readme"):
            with pytest.raises(RevisionError, match="no such revision"):
                found.resolve(name)
    assert not other.exists()
    listed = subprocess.run(["git", "-C", str(folder), "worktree", "list"], capture_output=True, text=True, check=True)
    assert len(listed.stdout.splitlines()) == 1
    assert (folder / "readme").read_text() == "2\n", "the working copy stays as it is"


def test_without_a_clone_there_are_no_revisions(tmp_path):
    with pytest.raises(RevisionError, match="does not run from a git clone"), revisions(tmp_path):
        pass


def test_a_revision_that_is_not_rtctl_is_told(clone, log):
    folder, commits = clone
    with revisions(folder) as found, pytest.raises(RevisionError, match=r"cannot replay this log.*not in the other"):
        found.outputs(commits[0], log)


def test_the_program_that_runs_elsewhere_gives_what_runs_here(log, tmp_path):
    """In a process of its own, on this very revision, so that nothing has to be compiled."""
    same = Revisions(ROOT, tmp_path, cache_directory().parent, {"c" * 40: ROOT})
    outputs = same.outputs("c" * 40, log, ticks=600)
    assert outputs.kernel_hash == kernel_hash()
    assert "rtctl/tick.py" in outputs.kernel_sources
    found = compare(outputs.rows, here(log, 600))
    assert (found.tick, found.ticks, found.not_compared) == (None, 600, ())


def test_settings_that_a_revision_does_not_know_are_left_out_unless_chosen():
    table = {"loop": {"period_s": 0.002, "brand_new": 7.0}, "newer": {"a": 1}}
    assert elsewhere.known(Settings, table, {"loop": {"period_s": 0.002}}) == {"loop": {"period_s": 0.002}}
    with pytest.raises(elsewhere.Unreadable, match=r"setting loop\.brand_new"):
        elsewhere.known(Settings, table, {"loop": {"brand_new": 7.0}})


def test_a_revision_from_before_rerun_is_driven_piece_by_piece(log):
    from rtctl import replay, rerun
    from rtctl.controller import Controller
    from rtctl.settings import from_table

    class Before:
        run_rows, _prepare = staticmethod(rerun.run_rows), staticmethod(rerun._prepare)

    controller = Controller(from_table(log.settings_table()))
    rows = elsewhere.as_here(log.controller, controller.table.dtype)
    rows["command_verdict"] = log.controller["command_verdict"]
    assert elsewhere.rerun(Before, controller, rows, replay.staged_in(log, controller)).tobytes() == here(log).tobytes()


class Scripted(Revisions):
    """A history in which the outputs change at one commit."""

    def __init__(self, rows, culprit):
        super().__init__(Path(), Path(), Path())
        self.rows, self.culprit, self.asked = rows, culprit, []

    def is_ancestor(self, _good, _bad):
        return True

    def subject(self, commit):
        return commit

    def touching(self, _good, _bad, files):
        assert files == ["a.py", "b.py"]
        return [f"{n:02d}" for n in range(1, 21)]

    def outputs(self, commit, _log, ticks=None):
        self.asked.append((commit, ticks))
        rows = self.rows[:ticks].copy()
        if int(commit) >= self.culprit:
            rows["command_desired_v"][400:, 1] += 1e-12
        return Outputs(rows, "", ("b.py",) if int(commit) else ("a.py",))


@pytest.mark.parametrize("culprit", [1, 2, 10, 19, 20])
def test_the_first_commit_that_differs_is_found(log, culprit):
    history = Scripted(here(log), culprit)
    found = bisect(history, log, "00", "20")
    assert found.commit == f"{culprit:02d}"
    assert (found.comparison.signal, found.comparison.row) == ("command_desired_v", 400)
    assert found.judged == len(history.asked) <= 7
    assert {ticks for _, ticks in history.asked[2:]} <= {401}, "no more ticks than are needed"


def test_nothing_differs_and_nothing_is_searched(log):
    history = Scripted(here(log), 99)
    assert bisect(history, log, "00", "20").commit is None
    assert len(history.asked) == 2


def test_the_other_interpreter_finds_the_other_revision(tmp_path):
    """PYTHONPATH goes before an editable installation."""
    (tmp_path / "rtctl").mkdir()
    (tmp_path / "rtctl" / "__init__.py").write_text("here = 1\n")
    code = "import rtctl; print(rtctl.here)"
    done = subprocess.run([sys.executable, "-P", "-c", code], env={"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True)  # fmt: skip
    assert done.stdout == "1\n"
