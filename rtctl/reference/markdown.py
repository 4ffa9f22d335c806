"""The little Markdown the pages are made of."""

import re
from collections.abc import Iterable, Sequence

NOTICE = "<!-- Written by `make docs/reference` from {source}; change that, not this page. -->"


def page(title: str, source: str, parts: Iterable[str]) -> str:
    """A page of `parts`, with a notice of what it is made from."""
    return "\n\n".join([NOTICE.format(source=source), f"# {title}", *parts]) + "\n"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table; bars, line breaks and angle brackets in the cells do it no harm."""

    def line(cells: Sequence[object]) -> str:
        return "| " + " | ".join(_cell(str(c)) for c in cells) + " |"

    return "\n".join([line(head), "|" + " --- |" * len(head), *(line(row) for row in rows)])


def blanks(text: str) -> str:
    """A message of the program with words where its numbers will be."""
    return re.sub(r"{(\w+)[^}]*}", r"*\1*", text)


def _cell(text: str) -> str:
    """Escaped for a table; between backquotes angle brackets are plain already."""
    parts = text.replace("|", "\\|").replace("\n", " ").split("`")
    return "`".join(part if i % 2 else part.replace("<", "&lt;") for i, part in enumerate(parts))
