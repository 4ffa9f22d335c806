"""``rtctl config`` and ``rtctl warmup``: what a run would be made of."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from rtctl.cli.console import remark, say, to_toml
from rtctl.cli.options import CONFIG, DEFAULT_CONFIG, JSON, SET, SETTINGS

if TYPE_CHECKING:
    from rtctl.settings import Settings

COMMENT_COLUMN = 46


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="Check and show settings.", no_args_is_help=True)
    group.command()(check)
    group.command()(show)
    app.add_typer(group, name="config", rich_help_panel=SETTINGS)
    app.command(rich_help_panel=SETTINGS)(warmup)


def check(config: Annotated[str, typer.Argument(help="Settings file.")], overrides: SET = None) -> None:
    """Check a settings file, the backend's own settings included; nothing is started.

    Example: `rtctl config check my-robot.toml`
    """
    from rtctl.settings import config_hash, find

    settings = _checked(config, overrides)
    say(
        f"{find(config)} is good: robot {settings.robot.name}, backend {settings.backend.name}, hash {config_hash(settings)}"
    )


def show(config: CONFIG = DEFAULT_CONFIG, overrides: SET = None, json: JSON = False) -> None:
    """Show every setting with its unit and meaning, as TOML that can be read back; passwords are hidden.

    Example: `rtctl config show planar-sim --set loop.priority=70`
    """
    import json as encoder

    from rtctl.settings import load, public_table

    settings = load(config, overrides or ())
    if json:
        say(encoder.dumps(public_table(settings), indent=2, ensure_ascii=False))
    else:
        say(as_toml(settings))


def warmup(config: CONFIG = DEFAULT_CONFIG, overrides: SET = None) -> None:
    """Compile every kernel into the cache, so that starting a controller compiles nothing.

    Example: `rtctl warmup planar-sim`
    """
    from rtctl.settings import load
    from rtctl.warmup import warm_up

    settings = load(config, overrides or ())
    remark("compiling what is missing; the first time this takes a minute")
    compiled = warm_up(settings)
    say(f"{len(compiled)} kernels compiled" if compiled else "everything was compiled already")


def as_toml(settings: "Settings") -> str:
    """All settings as TOML, with units and meanings as comments."""
    from hal.options import describe
    from rtctl.settings import Settings, public_table

    comments = {name: field.metadata for name, _, field in describe(Settings)}
    lines: list[str] = []
    for section, table in public_table(settings).items():
        lines += ["", f"[{section}]"]
        for name, value in table.items():
            if isinstance(value, dict):
                continue
            meta: dict[str, Any] = dict(comments.get(f"{section}.{name}", {}))
            unit = f"[{meta['unit']}] " if meta.get("unit") else ""
            lines.append(
                f"{f'{name} = {to_toml(value)}':<{COMMENT_COLUMN}}  # {unit}{meta.get('doc', '')}".rstrip(" #")
            )
        lines += _tables(section, table)
    return "\n".join(lines[1:])


def _tables(path: str, table: dict[str, Any]) -> list[str]:
    """The tables inside a table, each under its own heading."""
    lines = []
    for name, value in table.items():
        if isinstance(value, dict) and value:
            lines += ["", f"[{path}.{name}]"]
            lines += [f"{key} = {to_toml(v)}" for key, v in value.items() if not isinstance(v, dict)]
            lines += _tables(f"{path}.{name}", value)
    return lines


def _checked(config: str, overrides: list[str] | None) -> "Settings":
    from hal.backend import load as load_backend
    from rtctl.settings import load

    settings = load(config, overrides or ())
    load_backend(settings.backend.name, settings.backend.options, period_s=settings.loop.period_s, seed=0)
    return settings
