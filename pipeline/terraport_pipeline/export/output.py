"""Files that are there whole or not at all: written beside, then renamed."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from terraport_pipeline.errors import OptionError

__all__ = ["writing_beside"]


@contextmanager
def writing_beside(
    path: Path,
    *,
    companions: tuple[str, ...] = (),
    force: bool,
    holds: frozenset[str] = frozenset(),
) -> Iterator[Path]:
    """Hand out an empty folder beside a file; what is in it at the end goes to its place.

    Parameters
    ----------
    path : Path
        The file that is wanted.
    companions : tuple of str
        Names of files or folders that come with it.
    force : bool
        Overwrite what is there.
    holds : frozenset of str
        A folder is wanted, with these names in it: one that has others is not overwritten.

    Yields
    ------
    Path
        A folder on the same file system, for files of these names. It goes in any case.

    Raises
    ------
    OptionError
        One of the files is there and shall not be overwritten, or there is no folder for them.
    """
    folder = path.absolute().parent
    if not folder.is_dir():
        raise OptionError(f"{path}: its folder {folder} is not there; make it, or choose another")
    names = (path.name, *companions)
    if not force:
        for name in names:
            if (folder / name).exists():
                raise OptionError(
                    f"{folder / name}: exists already; choose another name or overwrite (--force)"
                )
    elif path.is_dir():
        if not holds:
            raise OptionError(f"{path}: is a folder, expected the name of a file")
        others = sorted({entry.name for entry in path.iterdir()} - holds)
        if others:
            raise OptionError(
                f"{path}: has {others[0]} in it, which is of no export like this; choose another "
                "folder, or empty it"
            )
    scratch = Path(tempfile.mkdtemp(prefix=f".{path.name}.export-", dir=folder))
    try:
        yield scratch
        # Companions first: a file that is there has all that it names beside it.
        for name in reversed(names):
            if (scratch / name).exists():
                if (folder / name).is_dir():
                    shutil.rmtree(folder / name)
                (scratch / name).replace(folder / name)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
