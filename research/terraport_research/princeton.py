"""Princeton's segmentation benchmark on disk: models, how people cut them, and into how many.

As published (``MeshsegBenchmark-1.0``), or a part of it: ``data/off/N.off``,
``data/seg/Benchmark/N/N_J.seg``, ``util/parameters/nSeg-By*.txt``. A folder, or a tar archive of
it. Models without people (the springs) are left out.

References
----------
X. Chen, A. Golovinskiy, T. Funkhouser, "A benchmark for 3D mesh segmentation", ACM Transactions on
Graphics 28(3), 2009.
"""

from __future__ import annotations

import io
import tarfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np

from terraport_payload.types import Float64, Int32
from terraport_pipeline.errors import SurveyError
from terraport_research.options import Mode

__all__ = ["CATEGORIES", "Benchmark", "Model", "mode_of_counts", "read_benchmark"]

CATEGORIES: Final = (
    "Human", "Cup", "Glasses", "Airplane", "Ant", "Chair", "Octopus", "Table", "Teddy", "Hand",
    "Plier", "Fish", "Bird", "Spring", "Armadillo", "Bust", "Mech", "Bearing", "Vase", "FourLeg",
)  # fmt: skip
"""Twenty models each, 1 to 20 and so on."""
_PER_CATEGORY: Final = 20

_FILES: Final = {
    "by-model": "nSeg-ByModel.txt",
    "by-category": "nSeg-ByCategory.txt",
}
_FOR_ALL: Final = 7


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A body and how people cut it."""

    number: int
    category: str
    vertices: Float64
    """(V, 3)"""
    faces: Int32
    """(F, 3)"""
    people: tuple[Int32, ...]
    """(F,) of each person."""
    k_by_model: int
    k_by_category: int

    def counts(self, mode: Mode) -> tuple[int, ...]:
        """Numbers of segments to ask for, one for each person's segmentation."""
        if mode == "by-segmentation":
            return tuple(len(np.unique(labels)) for labels in self.people)
        k = {"by-model": self.k_by_model, "by-category": self.k_by_category}.get(mode, _FOR_ALL)
        return (k,) * len(self.people)


@dataclass(frozen=True, slots=True)
class Benchmark:
    """Where the models are; they are read one after the other."""

    path: Path
    numbers: tuple[int, ...]
    """Of the models that have people."""

    @staticmethod
    def category(number: int) -> str:
        """Say of which kind a model is."""
        return CATEGORIES[(number - 1) // _PER_CATEGORY]

    def models(self, numbers: tuple[int, ...] | None = None) -> Iterator[Model]:
        """Read models in ascending order; None: all.

        Raises
        ------
        SurveyError
            A file is damaged, or its rows are not the faces of its model.
        """
        files = _Files.open(self.path)
        by_model, by_category = (files.table(name) for name in _FILES.values())
        for number in self.numbers if numbers is None else numbers:
            category = self.category(number)
            vertices, faces = _read_off(files.text(f"data/off/{number}.off"), number)
            people = [
                _read_labels(files.text(name), number, len(faces)) for name in files.people(number)
            ]
            counts = [len(np.unique(labels)) for labels in people]
            yield Model(
                number,
                category,
                vertices,
                faces,
                tuple(people),
                by_model.get(number) or mode_of_counts(counts),
                by_category.get(number) or mode_of_counts(counts),
            )


def read_benchmark(path: Path) -> Benchmark:
    """Look for models.

    Parameters
    ----------
    path : Path
        Folder, or tar archive (``.tar``, ``.tar.gz``, ``.tar.xz``).

    Raises
    ------
    SurveyError
        Neither, or without a model that people have cut.
    """
    files = _Files.open(path)
    numbers = sorted(
        int(PurePosixPath(name).stem)
        for name in files.names
        if name.startswith("data/off/") and PurePosixPath(name).stem.isdigit()
    )
    known = len(CATEGORIES) * _PER_CATEGORY
    with_people = tuple(n for n in numbers if n <= known and files.people(n))
    if not with_people:
        raise SurveyError(
            f"{path} has no model that people have cut; expected data/off/N.off and "
            "data/seg/Benchmark/N/N_J.seg, as Princeton's MeshsegBenchmark-1.0 has them"
        )
    return Benchmark(path, with_people)


def mode_of_counts(counts: list[int]) -> int:
    """Find the commonest; of several the one closest to the median, then the lowest."""
    tally = Counter(counts)
    most = max(tally.values())
    median = float(np.median(counts))
    return min(
        (k for k, times in tally.items() if times == most), key=lambda k: (abs(k - median), k)
    )


@dataclass(frozen=True, slots=True)
class _Files:
    """The benchmark's files by name, in a folder or in memory."""

    names: frozenset[str]
    folder: Path | None
    held: dict[str, bytes]

    @classmethod
    def open(cls, path: Path) -> _Files:
        if path.is_dir():
            wanted = [*path.glob("data/off/*.off"), *path.glob("data/seg/Benchmark/*/*.seg"),
                      *path.glob("util/parameters/*.txt")]  # fmt: skip
            names = frozenset(found.relative_to(path).as_posix() for found in wanted)
            return cls(names, path, {})
        if not path.is_file():
            raise SurveyError(f"{path} is not there; expected a folder or archive of the benchmark")
        held = {}
        try:
            with tarfile.open(fileobj=io.BytesIO(path.read_bytes())) as tar:
                for member in tar:
                    file = tar.extractfile(member) if member.isfile() else None
                    if file is not None and member.name.endswith((".off", ".seg", ".txt")):
                        held[member.name.removeprefix("./")] = file.read()
        except tarfile.TarError as error:
            raise SurveyError(f"{path} is no tar archive ({error})") from error
        return cls(frozenset(held), None, held)

    def text(self, name: str) -> str:
        data = self.held[name] if self.folder is None else (self.folder / name).read_bytes()
        return data.decode("ascii", "replace")

    def people(self, number: int) -> list[str]:
        """Names of a model's segmentations, in the order of their numbers."""
        folder = f"data/seg/Benchmark/{number}/"
        names = [name for name in self.names if name.startswith(folder)]
        return sorted(names, key=lambda name: (len(name), name))

    def table(self, name: str) -> dict[int, int]:
        """Read a number a line, of models from 1; empty where there is no such file."""
        path = f"util/parameters/{name}"
        if path not in self.names:
            return {}
        words = self.text(path).split()
        return {number: int(word) for number, word in enumerate(words, 1) if int(word) > 0}


def _read_off(text: str, number: int) -> tuple[Float64, Int32]:
    words = text.split()
    try:
        n_vertices, n_faces = int(words[1]), int(words[2])
        split = 4 + 3 * n_vertices
        vertices = np.array(words[4:split], np.float64).reshape(n_vertices, 3)
        rows = np.array(words[split : split + 4 * n_faces], np.int32).reshape(n_faces, 4)
    except (ValueError, IndexError) as error:
        raise SurveyError(f"model {number}: its OFF cannot be read ({error})") from error
    return vertices, np.ascontiguousarray(rows[:, 1:])


def _read_labels(text: str, number: int, n_faces: int) -> Int32:
    labels = np.array(text.split(), np.int32)
    if len(labels) != n_faces:
        raise SurveyError(
            f"model {number}: a segmentation of {len(labels)} rows; expected {n_faces}, one a face"
        )
    return labels
