"""What the pages tell people to type works: commands, Python, links, and the tutorial from its first line to its last."""

import os
import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import typer

from rtctl import planner
from rtctl.cli import app, main
from rtctl.cli.client import AT_ONCE
from rtctl.commands import Reason, Verb
from rtctl.lifecycle import Operating, Task
from rtctl.lockstep import Lockstep
from rtctl.settings import load

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
WRITTEN = [p for p in PAGES if p.parent.name != "reference"]
TUTORIAL = ROOT / "docs" / "tutorial" / "your-first-insertion.md"
NEEDS_NO_CONTROLLER = ("sim", "log", "replay", "config", "warmup", "detector")
FILE_OR_SIMULATION = ("backlash", "record", "stiffness", "array", "shape", "saline", "--sim")
"""What a calibration that needs no controller has among its words."""
NEEDS_CONTROLLER = "<!-- needs a controller -->"
FAULT = 5


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def blocks(page: Path, language: str) -> list[tuple[str, str]]:
    """(line before, content) of every block of that language."""
    return re.findall(rf"^([^\n]*)\n```{language}\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)


def console(page: Path) -> list[list[str]]:
    """Words of every `rtctl` command of a page."""
    lines = [line for _, block in blocks(page, "console") for line in block.splitlines()]
    return [shlex.split(line[2:], comments=True)[1:] for line in lines if line.startswith("$ rtctl ")]


WITH_COMMANDS = [p for p in WRITTEN if console(p)]


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """A folder with nothing but the documentation in it, and plans that are computed once in all tests."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.setattr(
        planner, "plan_insertion", lambda matrix, *_, **patient: remembered(matrix.tobytes(), **patient)
    )


@cache
def remembered(matrix: bytes, **patient):
    from rtctl.electrode.planning import plan_insertion

    return plan_insertion(np.frombuffer(matrix).reshape(4, 4), **patient)


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=name)
def test_commands_are_understood(page):
    root = typer.main.get_command(app)
    for words in console(page):
        command, context, rest = root, None, ["rtctl", *words]
        while hasattr(command, "commands") and rest[1:] and not rest[1].startswith("-"):
            context = command.make_context(rest[0], rest[1:2], parent=context, resilient_parsing=True)
            command, rest = command.commands[rest[1]], rest[1:]
        assert not hasattr(command, "commands") or command.invoke_without_command
        command.make_context(rest[0], rest[1:], parent=context)


@pytest.mark.usefixtures("workplace")
@pytest.mark.parametrize("page", WITH_COMMANDS, ids=name)
def test_commands_that_need_no_controller_run(page, capsys):
    for words in console(page):
        alone = words[0] in NEEDS_NO_CONTROLLER or (words[0] == "calibrate" and set(words) & set(FILE_OR_SIMULATION))
        alone = alone or (words[0] == "scope" and "--log" in words)
        alone = alone or (words[0] == "plan" and words[1:] and words[1] != "load")
        if alone and "$log" not in words:
            expected = FAULT if any("inject" in word for word in words) else 0
            assert main(words) == expected, f"{' '.join(words)}\n{capsys.readouterr().err}"
            assert "Traceback" not in capsys.readouterr().err


WITH_PYTHON = [p for p in WRITTEN if any(NEEDS_CONTROLLER not in before for before, _ in blocks(p, "python"))]


@pytest.mark.usefixtures("workplace")
@pytest.mark.parametrize("page", WITH_PYTHON, ids=name)
def test_python_runs(page, capsys):
    if "log.mcap" in page.read_text():
        assert main(["sim", "planar-sim", "--log", "log.mcap"]) == 0
    scope: dict = {"__name__": "example"}
    for before, code in blocks(page, "python"):
        if NEEDS_CONTROLLER not in before:
            exec(compile(code, name(page), "exec"), scope)
    assert capsys.readouterr().out


def test_python_that_needs_a_controller_fits_the_code(tmp_path):
    codes = [code for page in WRITTEN for before, code in blocks(page, "python") if NEEDS_CONTROLLER in before]
    assert len(codes) == 3
    for i, code in enumerate(codes):
        (tmp_path / f"example_{i}.py").write_text(code)
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--config-file",
        str(ROOT / "pyproject.toml"),
        *map(str, sorted(tmp_path.iterdir())),
    ]
    environment = os.environ | {"MYPYPATH": str(ROOT), "MYPY_CACHE_DIR": str(tmp_path / "cache")}
    result = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    for target in re.findall(r"(?<!!)\[[^\]]*\]\(([^)#\s]+)", text):
        if "://" not in target:
            assert (page.parent / target).exists(), target


def test_the_tutorial_leads_into_the_cochlea_and_out_again():
    """Its commands in order, in lockstep: nobody waits."""
    lockstep = Lockstep(load("planar-sim"), seed=0)
    verbs = {command: Verb[verb] for command, (verb, _) in AT_ONCE.items()}
    verbs |= {"home": Verb.HOME, "unbias": Verb.UNBIAS, "move": Verb.MOVE_CP, "approach": Verb.APPROACH,
              "insert": Verb.INSERT, "retract": Verb.RETRACT}  # fmt: skip
    deepest_mm, told = 0.0, []
    for words in console(TUTORIAL):
        command, numbers = words[0], words[1:]
        if command == "plan":
            c = lockstep.controller
            entry = c.memory["state"]["pose_entry"][0]
            c.memory["staged_plan"] = planner.make_plan(c.settings, c.robot, entry, 1)
            record = lockstep.command(Verb.LOAD_PLAN, 1.0)
        elif command in verbs:
            record = lockstep.command(verbs[command], *map(float, numbers))
        else:
            continue
        told.append((command, Reason(int(record["command_verdict"]))))
        for _ in range(6 if command == "insert" else 60):  # what comes after `insert` is typed while it runs
            record = lockstep.advance(1000)
            if not record["is_busy"]:
                break
        deepest_mm = max(deepest_mm, float(record["depth_mm"]))
        assert record["operating_state"] != Operating.FAULT, command
    refused = [(command, reason) for command, reason in told if reason is not Reason.ACCEPTED]
    assert refused == [("move", Reason.OUTSIDE_BOX)]
    assert [command for command, _ in told][-4:] == ["pause", "resume", "retract", "disable"]
    assert deepest_mm == pytest.approx(15.0)
    assert record["depth_mm"] == pytest.approx(0.0, abs=1e-6)
    assert record["task_state"] == Task.IDLE or record["task_state"] == Task.DONE


def test_every_reason_of_the_gateway_is_explained():
    sources = "".join(p.read_text() for p in (ROOT / "rtctl" / "gateway").glob("*.py"))
    reasons = set(re.findall(r"(?:Refusal|from_error)\(\s*\"([a-z_]+)\"", sources))
    assert len(reasons) > 15
    page = (ROOT / "docs" / "how-to" / "operate-by-zenoh.md").read_text()
    assert {reason for reason in reasons if f"`{reason}`" not in page} == set()
