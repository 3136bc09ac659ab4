"""The manifest, ``scene.json``: what a scene is, and which files hold it.

PURE: no I/O, no clock. Nothing in it depends on when or where it was built, so the same survey and
options give the same bytes and the same version.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal

import numpy as np
import pydantic
from pydantic import BaseModel, ConfigDict, Field, JsonValue, field_validator

from terraport_payload import AttributeScale
from terraport_payload.segment_format import MAX_ATTRIBUTES
from terraport_payload.types import AnyFloat, Float64
from terraport_store.errors import DamagedSceneError
from terraport_store.layout import (
    BASE,
    COVER,
    ENCODING,
    FORMAT_VERSION,
    INDEX,
    MANIFEST_NAME,
    MAX_LEVELS,
    MAX_MANIFEST_BYTES,
    REGIONS,
)

__all__ = [
    "EAST_NORTH_UP",
    "AttributeInfo",
    "Axis",
    "Bounds",
    "BuildInfo",
    "Counts",
    "CrsInfo",
    "EncodingInfo",
    "FileInfo",
    "HandOff",
    "InputInfo",
    "Limits",
    "Manifest",
    "SurveyUnits",
    "TextureInfo",
    "manifest_digest",
]

_Count = Annotated[int, Field(ge=0, lt=1 << 53)]
_Length = Annotated[float, Field(ge=0, allow_inf_nan=False)]
_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Vector = tuple[_Finite, _Finite, _Finite]
_Name = Annotated[str, Field(min_length=1, max_length=200)]
_Hash = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]

VERSION_DIGITS: Final = 32
"""Hexadecimal digits of a version: 128 bits, so two scenes never share one by chance."""


class _Frozen(BaseModel):
    # Unknown keys are skipped: a newer minor version may add some.
    model_config = ConfigDict(frozen=True, extra="ignore")


class CrsInfo(_Frozen):
    """The survey's coordinate reference system."""

    name: str
    wkt: str = ""
    epsg: int | None = None


Axis = Literal["east", "west", "north", "south", "up", "down"]
"""Direction in which a coordinate increases."""

EAST_NORTH_UP: Final[tuple[Axis, Axis, Axis]] = ("east", "north", "up")

_TARGET: Final = {"east": 0, "west": 0, "north": 1, "south": 1, "up": 2, "down": 2}
_BACKWARDS: Final = frozenset({"west", "south", "down"})


class SurveyUnits(_Frozen):
    """The survey's own coordinates, where they are not easting, northing, height in metres."""

    horizontal_m: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Metres in one unit of x and y."""
    height_m: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    axes: tuple[Axis, Axis, Axis] = EAST_NORTH_UP
    """Directions of x, y and z."""
    crs_wkt: str = ""
    """The CRS that these coordinates are in; empty where none is known."""

    @field_validator("axes")
    @classmethod
    def _are_perpendicular(cls, axes: tuple[Axis, Axis, Axis]) -> tuple[Axis, Axis, Axis]:
        if sorted(_TARGET[axis] for axis in axes[:2]) != [0, 1] or _TARGET[axes[2]] != 2:
            raise ValueError(f"axes are {axes}, expected such as east, north, up")
        return axes

    @property
    def is_mirrored(self) -> bool:
        """True if x, y, z are left-handed."""
        swapped = _TARGET[self.axes[0]] == 1
        return (sum(axis in _BACKWARDS for axis in self.axes) + swapped) % 2 == 1

    def to_metres(self, coordinates: AnyFloat) -> Float64:
        """Convert x, y (and z) of the survey, (N, 2) or (N, 3), to easting, northing, height."""
        given = np.asarray(coordinates, np.float64)
        result = np.empty_like(given)
        for column in range(given.shape[1]):
            result[:, _TARGET[self.axes[column]]] = given[:, column] * self._unit(column)
        return result

    def from_metres(self, metres: AnyFloat) -> Float64:
        """Convert easting, northing (and height) in metres to x, y (and z) of the survey."""
        given = np.asarray(metres, np.float64)
        result = np.empty_like(given)
        for column in range(given.shape[1]):
            result[:, column] = given[:, _TARGET[self.axes[column]]] / self._unit(column)
        return result

    def document(self) -> dict[str, Any]:
        """Return the values for JSON, without defaults."""
        document = self.model_dump(mode="json")
        if self.axes == EAST_NORTH_UP:
            del document["axes"]
        if not self.crs_wkt:
            del document["crs_wkt"]
        return document

    def _unit(self, column: int) -> float:
        """Metres per unit of a column, negative if it increases to the west, south or down."""
        unit_m = self.height_m if column == 2 else self.horizontal_m
        return -unit_m if self.axes[column] in _BACKWARDS else unit_m


class Bounds(_Frozen):
    """An axis-aligned box, metres, scene frame."""

    min: _Vector
    max: _Vector


class EncodingInfo(_Frozen):
    """One encoding of the segments: keys of its two files, and what it is."""

    pack: _Name
    index: _Name
    media_type: _Name
    payload_bytes: _Count


class AttributeInfo(_Frozen):
    """One per-vertex attribute of the survey and its scale: value = offset + step * code."""

    name: _Name
    gltf_name: _Name
    offset: _Finite
    step: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    min: _Finite | None = None
    """Smallest value in the scene; None when no vertex has one."""
    max: _Finite | None = None


class Counts(_Frozen):
    """How much of everything there is."""

    points: _Count
    base_vertices: _Count
    base_faces: _Count
    detail_vertices: _Count
    """Over all segments; a vertex on a border counts once in each segment that uses it."""
    detail_faces: _Count
    segments: _Count
    regions: _Count


class TextureInfo(_Frozen):
    """What there is of textures; field table in ``spec/scene-format.md``, section 4."""

    source: Literal["photos", "vertex", "mesh"]
    media_types: tuple[_Name, ...]
    segments: _Count
    """Payloads with a texture."""
    base_side: _Count
    """Pixels; 0 where the base has no texture."""
    max_side: _Count
    """Pixels, of any segment; 0 where none has a texture."""
    image_bytes: _Count
    texels: _Count
    """Over all segments."""
    texel_m: _Length
    """Median length of a texel on the ground; of the base's where no segment has a texture."""
    gsd_m: _Length | None = None
    """Median ground sampling distance of the photos."""


class HandOff(_Frozen):
    """What the cover was built with."""

    deviation_m: _Length
    """Measured distance of base and detail (99.9th percentile)."""
    tolerance_m: _Length
    """Distance within which a segment counts as lying over a base face."""


class Limits(_Frozen):
    """Largest segment, so that clients can size their buffers."""

    max_segment_bytes: _Count
    max_segment_faces: _Count
    max_extent_m: _Length


class InputInfo(_Frozen):
    """The survey's points as they were read, whichever files they came in."""

    name: str
    bytes: _Count
    xxh3: _Hash


class BuildInfo(_Frozen):
    """Who built it, from what, how. No times: those stand in ``build.json``."""

    terraport: str
    options: dict[str, JsonValue] = {}
    input: InputInfo | None = None
    warnings: tuple[str, ...] = ()
    """What looks wrong with the survey, or with what was made of it."""
    choices: tuple[str, ...] = ()
    """What the build decided otherwise than asked."""
    stages: tuple[dict[str, JsonValue], ...] = ()


class FileInfo(_Frozen):
    """One file of the scene."""

    path: Annotated[
        str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}/[A-Za-z0-9][A-Za-z0-9._-]{0,99}$")
    ]
    """Relative to the scene directory, exactly one folder deep: it can never lead outside."""
    bytes: _Count
    xxh3: _Hash
    """XXH3-64 (seed 0) of the whole file."""


class Manifest(_Frozen):
    """Contents of ``scene.json``; field table in ``spec/scene-format.md``."""

    format: Literal["terraport-scene"] = "terraport-scene"
    format_version: Annotated[str, Field(pattern=r"^1\.[0-9]{1,4}$")] = FORMAT_VERSION
    version: Annotated[str, Field(pattern=rf"^[0-9a-f]{{{VERSION_DIGITS}}}$")]
    name: _Name
    crs: CrsInfo | None = None
    origin: _Vector
    """E0, N0, H0: scene position (0, 0, 0) in the CRS."""
    survey_units: SurveyUnits | None = None
    step_m: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    bounds: Bounds
    encodings: dict[str, EncodingInfo]
    attributes: Annotated[tuple[AttributeInfo, ...], Field(max_length=MAX_ATTRIBUTES)] = ()
    counts: Counts
    has_colour: bool
    """Whether every segment has vertex colours, and the base those or a texture; false, too, where
    textures stand in the segments' place."""
    textures: TextureInfo | None = None
    levels: Annotated[int, Field(ge=1, le=MAX_LEVELS)] = 1
    """Payloads of each segment: the detail, then coarser ones."""
    hand_off: HandOff
    limits: Limits
    build: BuildInfo
    files: dict[str, FileInfo]

    @property
    def scales(self) -> dict[str, AttributeScale]:
        """Scales of the attributes, in the order of the segments' masks."""
        return {info.name: AttributeScale(info.offset, info.step) for info in self.attributes}

    @property
    def folder(self) -> str:
        """Folder of this version, relative to the scene directory."""
        return self.files[BASE].path.partition("/")[0]

    def _document(self) -> dict[str, Any]:
        """Give the plain values; what a scene does not use changes none of its bytes."""
        document = self.model_dump(mode="json")
        if self.survey_units is None:
            del document["survey_units"]
        else:
            document["survey_units"] = self.survey_units.document()
        if document["levels"] == 1:
            del document["levels"]
        return document

    def digest(self) -> str:
        """Compute the version that the contents ask for; see :func:`manifest_digest`."""
        return manifest_digest(self._document())

    def to_bytes(self) -> bytes:
        """Write ``scene.json``; same contents, same bytes."""
        return (
            json.dumps(self._document(), indent=1, allow_nan=False, ensure_ascii=False) + "\n"
        ).encode("utf-8")

    @classmethod
    def from_bytes(cls, data: bytes) -> Manifest:
        """Read ``scene.json``.

        Parameters
        ----------
        data : bytes
            The whole file.

        Returns
        -------
        Manifest
            Checked field by field; whether the files are there is the reader's business.

        Raises
        ------
        DamagedSceneError
            Naming the first field that is wrong, or the format version that is not understood.
        """
        if len(data) > MAX_MANIFEST_BYTES:
            raise DamagedSceneError(
                MANIFEST_NAME, f"{len(data)} bytes, expected at most {MAX_MANIFEST_BYTES}"
            )
        try:
            document = json.loads(data)
        except (ValueError, RecursionError) as error:
            raise DamagedSceneError(MANIFEST_NAME, f"does not parse as JSON: {error}") from None
        _check_format(document)
        try:
            manifest = cls.model_validate(document)
        except pydantic.ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(step) for step in first["loc"])
            raise DamagedSceneError(MANIFEST_NAME, f"field {where!r}: {first['msg']}") from None
        needed = {BASE, COVER, REGIONS, INDEX}
        for encoding in manifest.encodings.values():
            needed |= {encoding.pack, encoding.index}
        missing = sorted(needed - set(manifest.files))
        if missing:
            raise DamagedSceneError(MANIFEST_NAME, f"no file {missing[0]!r} in files")
        return manifest


def manifest_digest(document: Mapping[str, Any]) -> str:
    """Compute the version of a manifest's contents.

    Parameters
    ----------
    document : mapping
        The parsed ``scene.json``.

    Returns
    -------
    str
        32 hexadecimal digits: the first half of the SHA-256 over the canonical JSON (sorted keys,
        no spaces) of everything but ``version``, each file's ``path`` replaced by its key. The
        folder's name is left out because it is made from the version.
    """
    contents = {key: value for key, value in document.items() if key != "version"}
    contents["files"] = {key: {**file, "path": key} for key, file in document["files"].items()}
    text = json.dumps(contents, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()[:VERSION_DIGITS]


def _check_format(document: Any) -> None:
    """Say "another format" or "another version" before any field is found wrong."""
    if not isinstance(document, Mapping) or document.get("format") != "terraport-scene":
        received = (
            document.get("format") if isinstance(document, Mapping) else type(document).__name__
        )
        raise DamagedSceneError(MANIFEST_NAME, f"format {received!r}, expected 'terraport-scene'")
    version = document.get("format_version")
    if not isinstance(version, str) or version.partition(".")[0] != "1":
        raise DamagedSceneError(MANIFEST_NAME, f"format_version {version!r}, expected 1.x")
    encodings = document.get("encodings")
    if isinstance(encodings, Mapping) and ENCODING not in encodings:
        names = ", ".join(sorted(encodings)) or "nothing"
        raise DamagedSceneError(
            MANIFEST_NAME,
            f"segments are stored as {names}, expected {ENCODING}; build the scene again with this "
            "version",
        )
    files = document.get("files")
    if isinstance(files, Mapping) and BASE not in files and "base.glb" in files:
        raise DamagedSceneError(
            MANIFEST_NAME,
            f"the base is stored as base.glb, expected {BASE}; build the scene again with this "
            "version",
        )
