"""What commands print: results to standard output, everything else to standard error, no colours where nobody looks."""

import sys
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

PIPE_WIDTH = 160
"""Letters in a line where there is no terminal to ask."""


@cache
def output() -> "Console":
    """The console of results."""
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else PIPE_WIDTH)


@cache
def side() -> "Console":
    """The console of progress and remarks."""
    from rich.console import Console

    return Console(stderr=True, highlight=False, soft_wrap=True)


def say(text: str = "") -> None:
    """One line of the result, as it is."""
    print(text, flush=True)


def remark(text: str) -> None:
    """One line beside the result."""
    print(text, file=sys.stderr, flush=True)


def say_error(text: str) -> None:
    """An error, in one line on standard error."""
    print(f"rtctl: {text}", file=sys.stderr, flush=True)


def grid(rows: dict[str, Any], title: str = "") -> "Table":
    """Names and values in two columns."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, show_header=False, title=title or None, title_justify="left", pad_edge=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    for name, value in rows.items():
        table.add_row(name, value if isinstance(value, Text) else Text(str(value)))
    return table


def to_toml(value: Any) -> str:
    """A plain value as TOML writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        import json

        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, list | tuple):
        return f"[{', '.join(to_toml(v) for v in value)}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{k} = {to_toml(v)}' for k, v in value.items())} }}" if value else "{}"
    return repr(value)
