"""``python -m rtctl.reference`` writes the pages, ``python -m rtctl.reference --check`` only compares."""

import argparse
import sys
from pathlib import Path

from hal.kernel import ROOT
from rtctl.reference.pages import PAGES

DIRECTORY = ROOT / "docs" / "reference"


def outdated(directory: Path) -> list[str]:
    """Names of the pages in `directory` that are not what the tables say, missing and superfluous ones included."""
    found = {p.name: p.read_text() for p in directory.glob("*.md") if p.name != "README.md"}
    wanted = {name: page() for name, page in PAGES.items()}
    return sorted(name for name in found.keys() | wanted.keys() if found.get(name) != wanted.get(name))


def main() -> int:
    """Write the pages, or with --check say which of them are out of date (exit code 1)."""
    parser = argparse.ArgumentParser(prog="python -m rtctl.reference", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 if a page is out of date")
    if parser.parse_args().check:
        old = outdated(DIRECTORY)
        if old:
            print(f"docs/reference is out of date ({', '.join(old)}): run `make docs/reference`", file=sys.stderr)
        return 1 if old else 0
    DIRECTORY.mkdir(parents=True, exist_ok=True)
    for name, page in PAGES.items():
        (DIRECTORY / name).write_text(page())
    return 0


if __name__ == "__main__":
    sys.exit(main())
