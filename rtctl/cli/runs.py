"""Folders of runs."""

from datetime import datetime
from pathlib import Path


def new_directory(parent: str | Path) -> Path:
    """A folder named by the time, which does not exist yet; it is not made."""
    name = datetime.now().astimezone().strftime("%Y-%m-%dT%H-%M-%S")
    path, number = Path(parent) / name, 1
    while path.exists():
        number += 1
        path = Path(parent) / f"{name}-{number}"
    return path
