"""Reads what the kernel tells in files, below any root: the machine's own, or one made up by a test."""

from pathlib import Path

from hal.errors import RtctlError


class Unreadable(RtctlError):
    """A fact the machine does not tell: the file is absent, closed to us, or says nothing that can be understood."""


class Facts:
    """The files below `root`; every method raises Unreadable, with the path and the reason, and never guesses."""

    def __init__(self, root: Path = Path("/")) -> None:
        self._root = root

    def text(self, path: str) -> str:
        """The content of the file, without white space around it."""
        try:
            return (self._root / path).read_text(errors="replace").strip()
        except OSError as error:
            raise Unreadable(f"/{path}: {(error.strerror or 'no reason given').lower()}") from None

    def number(self, path: str) -> int:
        """The whole number in the file."""
        text = self.text(path)
        try:
            return int(text)
        except ValueError:
            raise Unreadable(f"/{path}: {text[:40]!r} is no whole number") from None

    def cores(self, path: str) -> set[int]:
        """The set of cores in the file, as in `0-2,5`; an empty file is an empty set."""
        return cores_of(self.text(path), path)

    def bytes_at(self, path: str, offset: int, size: int) -> bytes:
        """`size` bytes of a file that is no text."""
        try:
            with (self._root / path).open("rb") as file:
                file.seek(offset)
                data = file.read(size)
        except OSError as error:
            raise Unreadable(f"/{path}: {(error.strerror or 'no reason given').lower()}") from None
        if len(data) != size:
            raise Unreadable(f"/{path}: only {len(data)} of {size} bytes")
        return data

    def folders(self, path: str, pattern: str) -> list[str]:
        """Paths of what matches `pattern` in a folder, sorted; none is Unreadable."""
        found = sorted(str(p.relative_to(self._root)) for p in (self._root / path).glob(pattern))
        if not found:
            raise Unreadable(f"/{path}: no {pattern} there")
        return found


def cores_of(text: str, source: str) -> set[int]:
    """The cores that `text` lists. Raises Unreadable if it is no such list."""
    cores: set[int] = set()
    for part in filter(None, text.split(",")):
        low, dash, high = part.partition("-")
        try:
            cores |= set(range(int(low), int(high if dash else low) + 1))
        except ValueError:
            raise Unreadable(f"/{source}: {text[:40]!r} is no list of cores") from None
    return cores
