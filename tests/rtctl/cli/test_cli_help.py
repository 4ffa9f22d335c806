"""The command line as a whole: every command explains itself, and exit codes mean what the table says."""

import subprocess
import sys

import pytest
import typer

from hal.errors import BackendError, OptionError
from rtctl.cli import app, main
from rtctl.cli.exit_codes import MEANING, Exit
from rtctl.commands import CommandRefused
from rtctl.log.format import LogError


def commands(group: typer.Typer, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """The words of every command below `group`."""
    found = [(*path, c.name or c.callback.__name__) for c in group.registered_commands]
    for sub in group.registered_groups:
        found += commands(sub.typer_instance, (*path, sub.name))
    return found


ALL = commands(app)
ISSUE = [
    "run",
    "demo",
    "sim",
    "status",
    "watch",
    "enable",
    "disable",
    "home",
    "move",
    "servo",
    "insert",
    "pause",
    "resume",
    "retract",
    "stop",
    "ack",
    "replay",
]


def test_every_verb_of_the_readme_exists():
    assert {(word,) for word in ISSUE} <= set(ALL)
    assert {("param", w) for w in ("get", "set", "list")} | {("log", w) for w in ("info", "plot", "recover")} <= set(
        ALL
    )
    assert {
        ("config", "check"),
        ("config", "show"),
        ("warmup",),
        ("plan", "make"),
        ("plan", "load"),
        ("register",),
    } <= set(ALL)


@pytest.mark.parametrize("words", ALL, ids=" ".join)
def test_every_command_has_help_with_an_example_of_itself(words, capsys):
    assert main([*words, "--help"]) == Exit.OK
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert f"Example: rtctl {' '.join(words)}" in text


def test_help_lists_the_exit_codes(capsys):
    assert main(["--help"]) == Exit.OK
    text = " ".join(capsys.readouterr().out.split())
    assert all(f"{code.value} {MEANING[code]}" in text for code in Exit)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [(["nonsense"], Exit.BAD_INPUT), (["sim", "--bogus"], Exit.BAD_INPUT), (["sim", "--seed", "x"], Exit.BAD_INPUT),
     (["move"], Exit.BAD_INPUT), (["sim", "no-such-settings"], Exit.BAD_INPUT), (["log", "info", "/no/such.mcap"], Exit.DATA)],
)  # fmt: skip
def test_bad_input_is_told_on_stderr_without_a_trace(arguments, code, capsys):
    assert main(arguments) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err
    assert "Traceback" not in captured.err


def test_errors_carry_the_codes_of_the_table():
    assert OptionError("x").exit_code == Exit.BAD_INPUT
    assert BackendError("x").exit_code == Exit.UNREACHABLE
    assert CommandRefused("busy", "x").exit_code == Exit.REFUSED
    assert LogError("x").exit_code == Exit.DATA


def test_help_and_simulation_need_neither_network_nor_numbers_at_first():
    program = (
        "import sys; from rtctl.cli import main; "
        "main(['sim', '--help']); heavy = {'numpy', 'numba', 'zenoh', 'matplotlib', 'rtctl.settings'} & set(sys.modules); "
        "assert not heavy, heavy; import rtctl.simulation, rtctl.report; assert 'zenoh' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)
