"""A mesh that was reconstructed elsewhere, found where a survey is looked for, with its files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import xxhash

from terraport_pipeline.engines.mesh_files.endings import GLTF_ENDINGS, MESH_ENDINGS
from terraport_pipeline.engines.mesh_files.gltf_files import gltf_companions
from terraport_pipeline.engines.mesh_files.obj_materials import obj_companions
from terraport_pipeline.engines.mesh_files.read_mesh import ply_image
from terraport_pipeline.engines.readers.read_ply import has_faces
from terraport_pipeline.errors import OptionError, SurveyError
from terraport_pipeline.mesh_statement import MeshStatement
from terraport_pipeline.survey.mesh_place import MeshPlace, mesh_place
from terraport_pipeline.survey_statement import SurveyStatement

__all__ = ["MeshInput", "find_mesh", "is_mesh"]

_PLY: Final = ".ply"


@dataclass(frozen=True, slots=True)
class MeshInput:
    """A mesh, what it is read with, and what is known of its coordinates."""

    path: Path
    files: tuple[Path, ...]
    """The mesh, its materials and images, and the files that state where it is."""
    place: MeshPlace
    survey: SurveyStatement
    mesh: MeshStatement
    hashes: tuple[str, ...] = ()
    """xxh3 of every file."""

    @property
    def up(self) -> str:
        """Axis that points up: ``y`` or ``z``."""
        return self.mesh.up or ("y" if self.path.suffix.lower() in GLTF_ENDINGS else "z")

    @property
    def size_bytes(self) -> int:
        """Bytes of all files together."""
        return sum(file.stat().st_size for file in self.files)

    @property
    def key(self) -> str:
        """What identifies all files' bytes, and which is named how."""
        named = "\0".join(
            f"{file.name} {digest}" for file, digest in zip(self.files, self.hashes, strict=True)
        )
        return xxhash.xxh3_128_hexdigest(named.encode())

    def hashed(self, hashes: Sequence[str]) -> MeshInput:
        """Give it the hashes of its files."""
        return replace(self, hashes=tuple(hashes))


def is_mesh(path: Path) -> bool:
    """Whether a file is a mesh by its kind: a PLY is one where it has faces."""
    kind = path.suffix.lower()
    return path.is_file() and (has_faces(path) if kind == _PLY else kind in MESH_ENDINGS)


def find_mesh(
    inputs: Sequence[Path], survey: SurveyStatement, mesh: MeshStatement
) -> MeshInput | None:
    """Find the mesh that was given in a survey's place; None where it is a survey.

    Parameters
    ----------
    inputs : sequence of Path
        What was given.
    survey, mesh
        What the user says of it.

    Raises
    ------
    SurveyError
        A mesh among other files.
    OptionError
        Something is stated of a mesh, and it is none; columns of one.
    ReadError
        What stands beside it cannot be read.
    """
    meshes = [] if mesh.as_points else [path for path in inputs if is_mesh(path)]
    if not meshes:
        if mesh.up is not None or mesh.shift is not None:
            raise OptionError(
                "--up and --shift are of meshes alone; points have heights in z, and whole "
                "coordinates"
            )
        return None
    if len(inputs) > 1:
        raise SurveyError(
            f"{meshes[0]} is a mesh, given with {len(inputs) - 1} more files; expected it alone: "
            "merge meshes in the program that made them, or build each as a scene"
        )
    if survey.columns is not None:
        raise OptionError(f"columns of {meshes[0].name}, which is a mesh; expected a text")
    [path] = meshes
    place = MeshPlace() if mesh.shift is not None and survey.crs is not None else mesh_place(path)
    files = tuple(dict.fromkeys((path, *_companions(path), *place.files)))
    return MeshInput(path, files, place, survey, mesh)


def _companions(path: Path) -> tuple[Path, ...]:
    """List the files of materials, images and buffers that a mesh refers to."""
    kind = path.suffix.lower()
    if kind in GLTF_ENDINGS:
        return gltf_companions(path)
    if kind == _PLY:
        image = ply_image(path)
        return () if image is None or not image.is_file() else (image,)
    return obj_companions(path) if kind == ".obj" else ()
