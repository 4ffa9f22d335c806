"""Which files a run on the command line stands for."""

from pathlib import Path


def logs_of(files: list[Path]) -> list[Path]:
    """The files themselves, those of a run for its folder. Raises LogError for a folder without any."""
    from rtctl.log.reader import LogError
    from rtctl.recording import logs_in

    found = [log for file in files for log in (logs_in(file) if file.is_dir() else [file])]
    if not found:
        raise LogError(
            "no log in this folder",
            value=", ".join(map(str, files)),
            remedy="give the folder of one run, or its log.mcap",
        )
    return found
