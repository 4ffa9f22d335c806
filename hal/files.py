"""Files that settings name."""

from importlib.resources import files
from pathlib import Path


def find(name: str) -> Path:
    """The file at the path `name`, or else the one that ships with rtctl under that bare name; it need not exist."""
    path = Path(name)
    if path.exists() or path.name != name:
        return path
    shipped = Path(str(files("config"))) / name
    return shipped if shipped.is_file() else path
