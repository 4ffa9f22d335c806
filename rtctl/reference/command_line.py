"""The program's own help as Markdown."""

from collections.abc import Iterator
from typing import Any

import typer

from rtctl.reference.markdown import table

WIDTH = 100


def commands(app: typer.Typer) -> Iterator[str]:
    """Heading, usage, explanation and parameters of every command of `app`, groups before what they hold."""
    root = typer.main.get_command(app)
    yield from _commands(root, root.make_context("rtctl", [], resilient_parsing=True, terminal_width=WIDTH))


def _commands(command: Any, context: Any) -> Iterator[str]:
    if context.parent is not None:
        yield f"## `{context.command_path}`"
    yield f"```\n{command.get_usage(context).removeprefix('Usage: ')}\n```"
    if command.help:
        yield _paragraphs(command.help)
    if command.epilog and context.parent is not None:
        yield _paragraphs(command.epilog)
    rows = [_row(p) for p in command.params if not getattr(p, "hidden", False)]
    if rows:
        yield table(("parameter", "default", "meaning"), rows)
    for name in getattr(command, "commands", {}):
        child = command.commands[name]
        if not child.hidden:
            yield from _commands(child, child.make_context(name, [], parent=context, resilient_parsing=True))


def _row(parameter: Any) -> tuple[str, ...]:
    option = parameter.param_type_name == "option"
    names = [*parameter.opts, *parameter.secondary_opts] if option else [parameter.metavar or parameter.name.upper()]
    default = parameter.default
    shown = (
        "" if default is None or default is False or callable(default) else "yes" if default is True else str(default)
    )
    if not option and parameter.required:
        shown = "required"
    return ", ".join(f"`{n}`" for n in names), shown, getattr(parameter, "help", "") or ""


def _paragraphs(text: str) -> str:
    """Paragraphs marked with backspace must not be wrapped: they become blocks of code."""
    return "\n\n".join(
        "```console\n" + p.replace("\b\n", "").replace("\b", "") + "\n```" if "\b" in p else p
        for p in (part.strip("\n") for part in text.split("\n\n"))
    )
