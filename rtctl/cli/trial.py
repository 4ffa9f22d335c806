"""Options of ``rtctl sim`` that say what insertion it is: specimen, ear, errors. Each is short for settings."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hal.errors import OptionError
from rtctl.cli.console import to_toml

if TYPE_CHECKING:
    from rtctl.settings import Settings

PANEL = "Which insertion"
BENCH = "backend.options"
SIDE, GRAVITY = f"{BENCH}.trial.side", "wrench.gravity_force_in_base_n"
WITH_SIDE = (SIDE, "cochlea.side", GRAVITY)
"""What is another for the other ear: truth, the controller's model of the patient, and the weight it expects."""

KEYS = {
    "--specimen": f"{BENCH}.trial.specimen",
    "--size": f"{BENCH}.anatomy.spiral_a_mm",
    "--side": SIDE,
    "--lateral": f"{BENCH}.trial.lateral_mm",
    "--out-of-plane": f"{BENCH}.trial.out_of_plane_mm",
    "--angle": f"{BENCH}.trial.angle_rad",
    "--stylet-offset": f"{BENCH}.array.stylet_offset_mm",
    "--speed": "workflow.speed_mm_per_s",
    "--scatter": f"{BENCH}.trial.scatter",
}
"""Option -> the setting it stands for."""


def _option(name: str, text: str, metavar: str = "") -> Any:
    return typer.Option(
        name, help=f"{text} [`{KEYS[name]}`]", metavar=metavar, rich_help_panel=PANEL, show_default=False
    )


SPECIMEN = Annotated[str | None, _option("--specimen", "What is inserted into.", "phantom|bone")]
SIZE = Annotated[float | None, _option("--size", "Size of the cochlea: A of its spiral, 3.2 to 4.6 mm.", "MM")]
SIDE_OF_HEAD = Annotated[
    str | None,
    _option(
        "--side", f"Ear, `cochlea.side` too; the robot is turned over for a left one, and `{GRAVITY}`.", "right|left"
    ),
]
LATERAL = Annotated[float | None, _option("--lateral", "The entry is so far left of where it was registered.", "MM")]
OUT_OF_PLANE = Annotated[float | None, _option("--out-of-plane", "The same, across the plane of insertion.", "MM")]
ANGLE = Annotated[float | None, _option("--angle", "The cochlea is turned so far from what was registered.", "RAD")]
STYLET_OFFSET = Annotated[
    float | None,
    _option("--stylet-offset", "The stylet was pulled so far while loading; negative: hooked late.", "MM"),
]
SPEED = Annotated[float | None, _option("--speed", "Insertion speed.", "MM/S")]
SCATTER = Annotated[
    bool | None,
    typer.Option(
        "--scatter/--no-scatter",
        help=f"Draw errors, array and friction from the seed; on with --count, else off. [`{KEYS['--scatter']}`]",
        rich_help_panel=PANEL,
        show_default=False,
    ),
]


def settings_with(config: str, overrides: list[str], given: Mapping[str, Any]) -> "Settings":
    """Settings from a file, ``--set`` and the options in `given` (option -> value, None if it was not given).

    Raises:
        OptionError: a setting is wrong, or named by ``--set`` and by its short form.
    """
    from rtctl.settings import load

    chosen = {option: value for option, value in given.items() if value is not None}
    written = list(overrides)
    for option, value in chosen.items():
        for key in WITH_SIDE if option == "--side" else (KEYS[option],):
            _refuse_twice(option, key, overrides)
        written.append(f"{KEYS[option]}={to_toml(value)}")
    if "--side" in chosen:
        written.append(f"cochlea.side={to_toml(chosen['--side'])}")
        before = load(config, overrides)
        if _side(before) != chosen["--side"]:
            x, y, z = before.wrench.gravity_force_in_base_n
            written.append(f"{GRAVITY}={to_toml([x, 0.0 - y, 0.0 - z])}")  # turned over about x; 0.0 - 0.0 has no sign
    return load(config, written)


def is_set(option: str, overrides: list[str]) -> bool:
    """True if ``--set`` names what `option` is short for."""
    return any(_overlap(_key(assignment), KEYS[option]) for assignment in overrides)


def _side(settings: "Settings") -> str:
    """The ear the settings are for; what is wrong with a table is for its backend to say."""
    trial = settings.backend.options.get("trial")
    return trial.get("side", "right") if isinstance(trial, dict) else "right"


def _refuse_twice(option: str, key: str, overrides: list[str]) -> None:
    for assignment in overrides:
        if _overlap(_key(assignment), key):
            raise OptionError(f"{option} and --set {assignment} both say what {key} is", remedy="leave one of them out")


def _key(assignment: str) -> str:
    return assignment.partition("=")[0].strip()


def _overlap(a: str, b: str) -> bool:
    """One of two dotted keys is, or contains, the other."""
    return f"{a}.".startswith(f"{b}.") or f"{b}.".startswith(f"{a}.")
