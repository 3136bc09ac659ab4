"""What was taught, as a file beside the scene: ``spec/ground-model.md``.

A zip of plain NumPy arrays and a JSON document. Nothing in it is executed: pickles are refused.
"""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from terraport_payload.types import Float32
from terraport_pipeline.errors import PlanError
from terraport_pipeline.export.output import writing_beside
from terraport_pipeline.geometry.learning.forest import Forest, forest_fault
from terraport_pipeline.geometry.learning.ground_units import feature_names
from terraport_pipeline.geometry.learning.unit_patches import PATCH_NAMES
from terraport_store.labels import label_fault

__all__ = ["MAX_CLASSES", "MAX_MODEL_BYTES", "GroundModel", "read_model", "write_model"]

FORMAT: Final = "terraport-ground-model"

MAX_MODEL_BYTES: Final = 256 << 20
"""Of all arrays of a model, unpacked."""

MAX_CLASSES: Final = 64
"""Names that a scene is taught at once."""

_TYPES: Final = {
    "roots": np.int64, "left": np.int32, "right": np.int32, "feature": np.int32,
    "threshold": np.float64, "share": np.float32, "middle": np.float32, "spread": np.float32,
}  # fmt: skip

_OF_FEATURES: Final = ("middle", "spread")

_MAX_DOCUMENT: Final = 1 << 20

_CELL_M: Final = (1e-3, 1e3)


@dataclass(frozen=True, slots=True, eq=False)
class GroundModel:
    """A forest, and what its columns and classes mean."""

    names: tuple[str, ...]
    """Of the classes, in their order."""
    cell_m: float
    """Side of the units' squares."""
    attributes: tuple[str, ...]
    """Of the survey, that it looks at beside colour and form."""
    forest: Forest
    middle: Float32
    """(K,) median of every feature over the ground that it was taught on."""
    spread: Float32
    """(K,) and the range of its middle half."""

    def aligned(self, features: Float32, middle: Float32) -> Float32:
        """Shift features of another survey so that their medians are those of the first.

        Another light, another camera and another noise move all ground alike. By half the spread at
        most, which ground that is other ground would exceed; attributes of the survey not at all.

        Parameters
        ----------
        features : ndarray of shape (U, K), float32
        middle : ndarray of shape (K,), float32
            Their medians.

        Returns
        -------
        ndarray of shape (U, K), float32
            `features` itself where nothing is shifted, as on the ground that was taught.
        """
        shift = np.clip(self.middle - middle, -self.spread / 2, self.spread / 2)
        shift[len(shift) - 2 * len(self.attributes) :] = 0.0
        if not shift.any():
            return features
        moved: Float32 = (features + shift).astype(np.float32)
        return moved

    @property
    def features(self) -> tuple[str, ...]:
        """Names of the columns."""
        names = feature_names(self.cell_m, self.attributes)
        attributes = len(names) - 2 * len(self.attributes)
        return (*names[:attributes], *PATCH_NAMES, *names[attributes:])


def write_model(path: Path, model: GroundModel, *, force: bool) -> None:
    """Write a model; the same model gives the same bytes.

    Raises
    ------
    OptionError
        The file is there and shall not be overwritten.
    """
    document = {
        "format": FORMAT,
        "format_version": "1.1",
        "names": list(model.names),
        "cell_m": model.cell_m,
        "attributes": list(model.attributes),
        "features": list(model.features),
    }
    with (
        writing_beside(path, force=force) as folder,
        zipfile.ZipFile(folder / path.name, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        # Without a time of the day: ZipInfo's own is 1980.
        archive.writestr(_entry("model.json"), json.dumps(document, indent=1))
        for name, kind in _TYPES.items():
            out = io.BytesIO()
            owner = model if name in _OF_FEATURES else model.forest
            array = np.ascontiguousarray(getattr(owner, name), kind)
            np.lib.format.write_array(out, array, version=(1, 0), allow_pickle=False)
            archive.writestr(_entry(f"{name}.npy"), out.getvalue())


def read_model(path: Path) -> GroundModel:
    """Read a model and check every number of it.

    Raises
    ------
    PlanError
        It is none, of another version, damaged, or larger than :data:`MAX_MODEL_BYTES`.
    OSError
        It cannot be read.
    """
    advice = "expected what terraport teach --save-model wrote"
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
            if size > MAX_MODEL_BYTES:
                raise PlanError(
                    path, f"{size:,} bytes unpacked, expected at most {MAX_MODEL_BYTES:,}", advice
                )
            document = json.loads(archive.read("model.json")[:_MAX_DOCUMENT])
            if not isinstance(document, dict) or document.get("format") != FORMAT:
                raise PlanError(path, f"no {FORMAT}", advice)
            version = document.get("format_version")
            if not isinstance(version, str) or version.partition(".")[0] != "1":
                raise PlanError(path, f"format_version {version!r}, expected 1.x", advice)
            arrays = {
                name: _array(archive.read(f"{name}.npy"), np.dtype(kind))
                for name, kind in _TYPES.items()
            }
    except (zipfile.BadZipFile, KeyError, ValueError, RecursionError, EOFError) as error:
        if isinstance(error, PlanError):
            raise
        raise PlanError(path, f"damaged, or no model ({error})", advice) from None
    names, cell_m = _texts(document.get("names")), document.get("cell_m")
    attributes = _texts(document.get("attributes"))
    if names is None or attributes is None or not 1 <= len(names) <= MAX_CLASSES:
        raise PlanError(path, "names or attributes are no lists of texts", advice)
    fault = next((label_fault(name) for name in names if label_fault(name)), None)
    if fault is not None:
        raise PlanError(path, fault, advice)
    if not isinstance(cell_m, int | float) or not _CELL_M[0] <= cell_m <= _CELL_M[1]:
        raise PlanError(path, f"cell_m {cell_m!r}, expected {_CELL_M[0]} to {_CELL_M[1]}", advice)
    of_features = {name: arrays.pop(name) for name in _OF_FEATURES}
    model = GroundModel(names, float(cell_m), attributes, Forest(**arrays), **of_features)
    if document.get("features") != list(model.features):
        raise PlanError(
            path, "other features than this release measures", "teach it again with strokes"
        )
    count = len(model.features)
    if any(a.shape != (count,) or not np.isfinite(a).all() for a in of_features.values()):
        raise PlanError(path, f"middle or spread that are not {count} numbers", advice)
    fault = forest_fault(model.forest, count, len(names))
    if fault is not None:
        raise PlanError(path, fault, advice)
    return model


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name)
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry


def _array(data: bytes, kind: np.dtype[Any]) -> Any:
    array = np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
    if array.dtype != kind:
        msg = f"an array of {array.dtype}, expected {kind}"
        raise ValueError(msg)
    return array


def _texts(value: object) -> tuple[str, ...] | None:
    if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
        return None
    return tuple(value)
