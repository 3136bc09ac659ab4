"""Points of a scene as LAS or LAZ: the centres of its triangles, each with its region and class.

Centres and not vertices: a triangle belongs to one region and one segment, so no point stands twice
and none is between two regions. Points are as dense as the mesh, and lie on it exactly.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import laspy
import numpy as np
from laspy.vlrs.known import ClassificationLookupVlr

from terraport_payload.types import AnyFloat, Float64, UInt8
from terraport_pipeline.engines.texturing import bilinear, decode_halved
from terraport_pipeline.errors import EngineError
from terraport_pipeline.export.frame import SurveyFrame
from terraport_pipeline.export.pieces import Piece, read_pieces
from terraport_pipeline.export.selection import SelectedScene, choose_segments
from terraport_pipeline.progress import Progress
from terraport_store import RegionNames, read_labels

__all__ = ["write_points"]

_CLASS: Final = "classification"
"""Attribute of surveys that come as LAS: the ASPRS class, whole numbers."""

_STEP_M: Final = 1e-3
"""Maximum step of the coordinates in the file; steps are powers of ten of the CRS's unit."""

_POINT_FORMAT: Final = 7
"""LAS 1.4: colours, and classes above 31."""

_OWN: Final = frozenset({"region", *laspy.PointFormat(_POINT_FORMAT).dimension_names})
"""Names that an attribute of the survey cannot have beside the others."""

_TAKEN: Final = "survey_"
"""Stands before such a name."""

_STANDARD: Final = {
    "ground": 2, "low vegetation": 3, "medium vegetation": 4, "high vegetation": 5, "vegetation": 5,
    "building": 6, "buildings": 6, "water": 9, "rail": 10, "road": 11, "roads": 11,
}  # fmt: skip
"""Names that ground may have which LAS 1.4 has a class for; all others are the user's own."""

_FIRST_OWN: Final = 64
"""LAS 1.4 leaves classes from here to 255 to its users."""

_LAST: Final = 255

_OTHERS: Final = "others"
"""What the last class is called where more names than it share it."""

_LOOKUP_NAME: Final = 15
"""ASCII bytes of a name in the table of classes."""

_MAX_NAME: Final = 32
"""Bytes of the name of an extra dimension."""


def write_points(path: Path, selected: SelectedScene, progress: Progress) -> dict[str, Any]:
    """Write the points of a selection, segment by segment.

    Parameters
    ----------
    path : Path
        Ends with .las or .laz.
    selected : SelectedScene
    progress : Progress
        A step of segments.

    Returns
    -------
    dict
        What to say of it.
    """
    manifest, frame = selected.scene.manifest, selected.frame
    names = [attribute.name for attribute in manifest.attributes]
    extra = {name: _dimension(name) for name in names if name != _CLASS}
    header = laspy.LasHeader(point_format=_POINT_FORMAT, version="1.4")
    header.scales, header.offsets = _scales(frame), np.array(frame.shift)
    header.system_identifier = "MODIFICATION"
    header.generating_software = f"terraport {manifest.build.terraport}"[:32]
    header.creation_date = None  # the same scene gives the same bytes
    # Ids that people use, where there are; -1 for a triangle of no region.
    dimensions = [laspy.ExtraBytesParams("region", np.int32, "stable id of the region")]
    dimensions += [laspy.ExtraBytesParams(name, np.float32) for name in extra.values()]
    header.add_extra_dims(dimensions)
    if frame.crs is not None:
        header.add_crs(frame.crs, keep_compatibility=False)
    named, class_names = _named_classes(selected)
    if class_names:
        lookup = ClassificationLookupVlr()
        for code, name in class_names.items():
            lookup[code] = name.encode("ascii", "replace").decode("ascii")[:_LOOKUP_NAME]
        header.vlrs.append(lookup)
    segments = choose_segments(selected)
    progress.start("points", len(segments), "segments")
    total = done = 0
    with laspy.open(path, mode="w", header=header) as file:
        for piece in read_pieces(selected, segments):
            file.write_points(_points(piece, selected, header, extra, named))
            total += len(piece.faces)
            reached = int(np.searchsorted(segments, piece.segment)) + 1
            progress.advance(reached - done)
            done = reached
    kinds = ["from the survey"] if _CLASS in names else []
    if class_names:
        listed = ", ".join(f"{code} {name}" for code, name in sorted(class_names.items()))
        kinds.insert(0, f"by name ({listed})")
    facts = {"points": f"{total:,}", "class": ", else ".join(kinds) or "none"}
    progress.done(facts)
    return facts


def _scales(frame: SurveyFrame) -> Float64:
    """Return the steps of x, y and z: a millimetre, a thousandth of a foot, 1e-6 of a kilometre."""
    units_m = np.array([frame.unit_m, frame.unit_m, frame.height_unit_m])
    scales: Float64 = 10.0 ** np.floor(np.log10(_STEP_M / units_m) + 1e-9)
    return scales


def _points(
    piece: Piece,
    selected: SelectedScene,
    header: laspy.LasHeader,
    extra: dict[str, str],
    named: UInt8,
) -> laspy.ScaleAwarePointRecord:
    record = laspy.ScaleAwarePointRecord.zeros(len(piece.faces), header=header)
    centres = selected.frame.to_survey(piece.positions[piece.faces].mean(axis=1))
    record.x, record.y, record.z = centres.T
    record.return_number = record.number_of_returns = np.ones(len(piece.faces), np.uint8)
    record["region"] = selected.selection.name_of(piece.regions).astype(np.int32)
    colours = _colours(piece)
    if colours is not None:
        # LAS has 16 bits a channel; the full range is what readers expect.
        for channel, name in enumerate(("red", "green", "blue")):
            record[name] = colours[:, channel].astype(np.uint16) * 257
    if _CLASS in piece.attributes:
        record.classification = _classes(piece.attributes[_CLASS][piece.faces])
    if len(named):
        code = np.append(named, 0).astype(np.uint8)[piece.regions]  # -1: none
        record.classification = np.where(code > 0, code, np.asarray(record.classification))
    for attribute, dimension in extra.items():
        values = piece.attributes.get(attribute)
        record[dimension] = (
            np.full(len(piece.faces), np.nan, np.float32)
            if values is None
            else values[piece.faces].mean(axis=1)
        )
    return record


def _named_classes(selected: SelectedScene) -> tuple[UInt8, dict[int, str]]:
    """Give what regions are called codes: by a table, a plan or strokes.

    Returns
    -------
    codes : ndarray of shape (R,), uint8
        By region; 0 of one without a name. Empty where none has any.
    names : dict of int to str
        By code.
    """
    scene = selected.scene
    names = RegionNames.of(scene.regions).with_labels(read_labels(scene.files))
    kinds = [names.label(region) for region in range(len(scene.regions.get("regions", [])))]
    wanted = sorted({kind for kind in kinds if kind is not None})
    own = [name for name in wanted if name.casefold() not in _STANDARD]
    code_of = {
        name: min(_FIRST_OWN + own.index(name), _LAST)
        if name in own
        else _STANDARD[name.casefold()]
        for name in wanted
    }
    if not code_of:
        return np.zeros(0, np.uint8), {}
    codes = [0 if kind is None else code_of[kind] for kind in kinds]
    called = {code: name for name, code in code_of.items()}
    if len(own) > _LAST - _FIRST_OWN + 1:
        called[_LAST] = _OTHERS
    return np.array(codes, np.uint8), called


def _classes(corners: AnyFloat) -> UInt8:
    """Class of triangles: the middle one of their corners', which two that agree decide."""
    middle = np.sort(np.nan_to_num(corners, nan=0.0), axis=1)[:, 1]
    classes: UInt8 = np.clip(np.rint(middle), 0, 255).astype(np.uint8)
    return classes


def _colours(piece: Piece) -> UInt8 | None:
    """SRGB levels at the centres: of the texture where it decodes, else of the vertices."""
    if piece.texture is not None and piece.uvs is not None:
        try:
            image = decode_halved(piece.texture.data, 0)
        except EngineError:
            image = None
        if image is not None:
            levels: AnyFloat = bilinear(image, piece.uvs[piece.faces].mean(axis=1))
            return np.rint(levels).astype(np.uint8)
    if piece.colours is None:
        return None
    mean: Float64 = piece.colours[piece.faces].mean(axis=1)
    return np.rint(mean).astype(np.uint8)


def _dimension(name: str) -> str:
    """Name of an attribute among the extra dimensions: ASCII, short, and nobody else's."""
    plain = name.encode("ascii", "replace").decode("ascii").replace("?", "_")
    return (_TAKEN + plain if plain.lower() in _OWN else plain)[:_MAX_NAME]
