"""Studies that made numbers of this repository, and can make them again: ``python -m studies.NAME --help``."""
