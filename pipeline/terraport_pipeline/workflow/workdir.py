"""The work directory of a build: results of stages, each whole or absent.

::

    WORK/
        <stage>/stage.json      key, options, facts, times, digests; written last
        <stage>/<array>.npy
        .<stage>.<random>.tmp/  being written, or left by a build that was killed
        .scratch.<random>.tmp/  files of an engine

A result is written beside, synced, and renamed into place. It is taken up again when its key (the
stage's name, its code, its options, the digests of its inputs) is unchanged and its
files have the size that was written.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
import numpy.typing as npt
import xxhash

from terraport_payload.types import AnyArray
from terraport_pipeline.engines.readers.npy_columns import NpyReader
from terraport_pipeline.errors import ResourceError, WorkDirectoryError
from terraport_pipeline.measure import StepCost
from terraport_pipeline.stages.contract import Facts, Json, Stored

__all__ = [
    "Cost",
    "StageRecord",
    "WorkDirectory",
    "file_digest",
    "is_work_directory",
    "stage_key",
]

_MARK: Final = ".terraport-work"
"""Says that a directory is ours, so that nothing else's files are ever deleted."""

_RECORD: Final = "stage.json"

_BLOCK_BYTES: Final = 1 << 24
"""Read at once where a file is digested."""

_DISK_FULL: Final = {
    errno.ENOSPC: "{free} free now",
    errno.EFBIG: "the limit of a file's size is reached",
    errno.EDQUOT: "a quota is reached",
}
"""What each error says of the disk; what the step had written is deleted by then."""

_DIGEST_BYTES: Final = 1 << 22
"""Bytes of a file in memory at once while they are hashed."""


@dataclass(frozen=True, slots=True)
class Cost:
    """What a stage took; differs from run to run."""

    seconds: float
    peak_bytes: int
    """Resident memory of this process and its children, at most."""
    steps: tuple[StepCost, ...] = ()
    """In their order; empty where nobody noted them."""


@dataclass(frozen=True, slots=True)
class StageRecord:
    """Key, digest, facts and cost of a kept result: the content of ``stage.json``."""

    name: str
    key: str
    digest: str
    """Hash of the result: arrays and values, not costs."""
    facts: Facts
    cost: Cost
    values: Mapping[str, Json]
    files: Mapping[str, int]
    """Size of every file, bytes, by name."""


class WorkDirectory:
    """Results of a build's stages on disk.

    Parameters
    ----------
    path : Path
        Created if it is not there.

    Raises
    ------
    WorkDirectoryError
        The path is a file, or a directory with something else in it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if path.exists() and not path.is_dir():
            raise WorkDirectoryError(f"{path} is not a directory; give --work another path")
        if path.is_dir() and not (path / _MARK).exists() and any(path.iterdir()):
            raise WorkDirectoryError(
                f"{path} holds files that no build wrote; give --work an empty or a new directory"
            )
        with disk_full_named(path):
            path.mkdir(exist_ok=True)
            (path / _MARK).touch()
        for left in path.glob(".*.tmp"):  # of a build that was killed; the lock says it is gone
            shutil.rmtree(left, ignore_errors=True)

    def find(self, name: str, key: str) -> StageRecord | None:
        """Look for a result.

        Parameters
        ----------
        name : str
            Of the stage.
        key : str
            From :func:`stage_key`.

        Returns
        -------
        StageRecord or None
            None when there is none, its key is another, or a file is missing or cut short.
        """
        record = self.latest(name)
        return record if record is not None and record.key == key else None

    def latest(self, name: str) -> StageRecord | None:
        """Look for a result, whatever its key; None when there is none that is whole."""
        folder = self.path / name
        try:
            record = _parse(json.loads((folder / _RECORD).read_bytes()))
            whole = all((folder / f).stat().st_size == size for f, size in record.files.items())
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return record if whole else None

    def load(self, record: StageRecord) -> Stored:
        """Read a result's arrays.

        Raises
        ------
        WorkDirectoryError
            A file cannot be read.
        """
        folder = self.path / record.name
        arrays = {}
        for file in record.files:
            try:
                arrays[Path(file).stem] = np.load(folder / file, allow_pickle=False)
            except (OSError, ValueError, EOFError) as error:
                raise WorkDirectoryError(
                    f"{folder / file} cannot be read ({error}); build again with --no-resume"
                ) from None
        return Stored(arrays, record.values)

    def looked_up(self, record: StageRecord) -> Stored:
        """Open a result without reading its arrays: each is mapped anew while it is looked at.

        Results of all tiles may be open together: every map that stayed open would hold a file
        descriptor, of which a process may have 1,024.
        """
        folder = self.path / record.name
        return Stored(_LookedUp({Path(f).stem: folder / f for f in record.files}), record.values)

    def array(self, record: StageRecord, name: str) -> AnyArray:
        """Load one array of a kept result into memory."""
        array: AnyArray = np.load(self.path / record.name / f"{name}.npy", allow_pickle=False)
        return array

    def save(self, name: str, key: str, stored: Stored, facts: Facts, cost: Cost) -> StageRecord:
        """Write a result and put it in place of an older one.

        Raises
        ------
        ResourceError
            The disk is full; the older result stands.
        """
        with self.beside(name) as folder:
            return self.seal(folder, name, key, stored, facts, cost)

    def seal(
        self, folder: Path, name: str, key: str, stored: Stored, facts: Facts, cost: Cost
    ) -> StageRecord:
        """Write a result into a folder and make it, with what lies there already, a kept one.

        Parameters
        ----------
        folder : Path
            From :meth:`beside`; may hold ``.npy`` files of arrays too large to be in memory.
        name, key : str
        stored : Stored
            Values, and the other arrays.
        facts, cost
        """
        values = json.loads(json.dumps(dict(stored.values), allow_nan=False))
        plain_facts = json.loads(json.dumps(asdict(facts)))
        digests, files = {}, {}
        for path in sorted(folder.glob("*.npy")):
            digests[path.name] = _npy_digest(path)
            with path.open("rb+") as file:
                _sync(file.fileno())
            files[path.name] = path.stat().st_size
        for array_name, array in stored.arrays.items():
            path = folder / f"{array_name}.npy"
            digests[path.name] = _array_digest(array)
            with path.open("wb") as file:
                _write_npy(file, np.ascontiguousarray(array))
                _sync(file.fileno())
            files[path.name] = path.stat().st_size
        whole = xxhash.xxh3_128_hexdigest(_canonical([digests, values]))
        return _write_record(folder, name, key, whole, plain_facts, cost, values, files)

    def forget(self, name: str) -> None:
        """Delete a result; nothing happens when there is none."""
        shutil.rmtree(self.path / name, ignore_errors=True)

    def names(self, prefix: str) -> list[str]:
        """Names of the results that begin with a prefix, sorted."""
        return sorted(path.parent.name for path in self.path.glob(f"{prefix}*/{_RECORD}"))

    @contextlib.contextmanager
    def scratch(self) -> Iterator[Path]:
        """Make an empty folder that is deleted at the end, whatever happens."""
        with disk_full_named(self.path):
            folder = Path(tempfile.mkdtemp(prefix=".scratch.", suffix=".tmp", dir=self.path))
        try:
            with disk_full_named(self.path):
                yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    @contextlib.contextmanager
    def beside(self, name: str) -> Iterator[Path]:
        """Make a folder that takes the stage's place when the block ends well."""
        with disk_full_named(self.path):
            beside = Path(tempfile.mkdtemp(prefix=f".{name}.", suffix=".tmp", dir=self.path))
            try:
                yield beside
                _sync_folder(beside)
                final = self.path / name
                if final.exists():
                    # Not atomic with the next line, and need not be: killed in between, the
                    # stage is simply done again.
                    final.rename(beside.with_name(f".{beside.name[1:]}.old.tmp"))
                beside.rename(final)
                _sync_folder(self.path)
            finally:
                shutil.rmtree(beside, ignore_errors=True)
                shutil.rmtree(beside.with_name(f".{beside.name[1:]}.old.tmp"), ignore_errors=True)


def is_work_directory(path: Path) -> bool:
    """Tell a build's work directory from any other folder."""
    return (path / _MARK).is_file()


def stage_key(name: str, code: str, options: Mapping[str, Json], inputs: Mapping[str, str]) -> str:
    """Compute what identifies a stage's result.

    Parameters
    ----------
    name : str
        Of the stage.
    code : str
        Digest of the code that makes the result.
    options : mapping
        Plain values; all that change the result, none that do not.
    inputs : mapping of str to str
        Digests by name.

    Returns
    -------
    str
        32 hexadecimal digits.

    Examples
    --------
    >>> stage_key("clean", "c", {"a": 1}, {}) == stage_key("clean", "c", {"a": 2}, {})
    False
    """
    return xxhash.xxh3_128_hexdigest(_canonical([name, code, dict(options), dict(inputs)]))


class _LookedUp(Mapping[str, AnyArray]):
    """Arrays that are mapped anew each time they are asked for."""

    def __init__(self, paths: Mapping[str, Path]) -> None:
        self._paths = paths

    def __getitem__(self, name: str) -> AnyArray:
        return _map(self._paths[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._paths)

    def __len__(self) -> int:
        return len(self._paths)


def _map(path: Path) -> AnyArray:
    try:
        array: AnyArray = np.load(path, mmap_mode="r", allow_pickle=False)
    except ValueError:  # an empty array cannot be mapped
        array = np.load(path, allow_pickle=False)
    return array


def file_digest(
    path: Path,
    advance: Callable[[int], None] | None = None,
    ranges: Sequence[tuple[int, int]] | None = None,
) -> str:
    """Compute the XXH3-64 of a file's bytes, 16 hexadecimal digits.

    Parameters
    ----------
    path : pathlib.Path
    advance : callable, optional
        Told how many bytes were read since it was last.
    ranges : sequence of (int, int), optional
        First byte and the one behind the last of what is read; where they lie counts, too. All
        bytes without it.
    """
    digest = xxhash.xxh3_64()
    if ranges is not None:
        digest.update(repr([*ranges]).encode())
    with path.open("rb") as file:
        for begin, end in ((0, None),) if ranges is None else ranges:
            file.seek(begin)
            while block := file.read(_left(file.tell(), end)):
                digest.update(block)
                if advance is not None:
                    advance(len(block))
    return digest.hexdigest()


def _left(at: int, end: int | None) -> int:
    """Bytes of a block that is read at once, up to the end of its range."""
    return _DIGEST_BYTES if end is None else min(_DIGEST_BYTES, max(0, end - at))


@contextlib.contextmanager
def disk_full_named(path: Path) -> Iterator[None]:
    """Turn "no space left" into an error that says where and what to do."""
    try:
        yield
    except OSError as error:
        if error.errno not in _DISK_FULL:
            raise
        disk = path if path.exists() else path.parent
        free = f"{shutil.disk_usage(disk).free / 2**20:,.1f} MiB"
        raise ResourceError(
            f"no space left for {path} ({_DISK_FULL[error.errno].format(free=free)}); free some, "
            "or give --work a directory on another disk"
        ) from error


def _write_record(
    folder: Path,
    name: str,
    key: str,
    digest: str,
    plain_facts: Json,
    cost: Cost,
    values: Json,
    files: Mapping[str, int],
) -> StageRecord:
    document = {
        "name": name,
        "key": key,
        "digest": digest,
        "facts": plain_facts,
        "cost": asdict(cost),
        "values": values,
        "files": dict(files),
    }
    with (folder / _RECORD).open("w", encoding="utf-8") as text:
        json.dump(document, text, indent=1)
        text.flush()
        _sync(text.fileno())
    return _parse(document)


def _parse(document: Any) -> StageRecord:
    facts, cost = document["facts"], document["cost"]
    return StageRecord(
        name=document["name"],
        key=document["key"],
        digest=document["digest"],
        facts=Facts(
            facts["counts"],
            tuple(facts["warnings"]),
            facts["notes"],
            tuple(facts.get("choices", ())),  # work directories from before have none
        ),
        cost=Cost(
            float(cost["seconds"]),
            int(cost["peak_bytes"]),
            tuple(StepCost(**step) for step in cost.get("steps", ())),
        ),
        values=document["values"],
        files=document["files"],
    )


def _canonical(document: Json) -> bytes:
    return json.dumps(document, sort_keys=True, separators=(",", ":")).encode("utf-8")


def _array_digest(array: npt.NDArray[np.generic]) -> str:
    whole = np.ascontiguousarray(array)
    digest = xxhash.xxh3_128(f"{whole.dtype.str}{whole.shape}".encode())
    digest.update(whole.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def _npy_digest(path: Path) -> str:
    """Compute what :func:`_array_digest` gives for the array in a file, by blocks."""
    reader = NpyReader(path)
    digest = xxhash.xxh3_128(f"{reader.dtype.str}{reader.shape}".encode())
    row_bytes = max(1, reader.dtype.itemsize * int(np.prod(reader.shape[1:])))
    for _, rows in reader.blocks(max(1, _BLOCK_BYTES // row_bytes)):
        digest.update(rows.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()


def _write_npy(file: BinaryIO, array: npt.NDArray[np.generic]) -> None:
    """Write as `np.save` does, but by `write`: `tofile` tells a full disk without its errno."""
    header = np.lib.format.header_data_from_array_1_0(array)
    np.lib.format.write_array_header_1_0(file, header)
    file.write(array.reshape(-1).view(np.uint8).data)
    file.flush()


def _sync(descriptor: int) -> None:
    os.fsync(descriptor)


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
