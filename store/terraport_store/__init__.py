"""Scene directories: read, write, check.

A scene is a directory that is published atomically; format in ``spec/scene-format.md``.

* :class:`Scene` (``Scene.open``), :func:`list_scenes`, :func:`read_manifest`: read;
* :class:`SceneWriter`: write a new version and publish it;
* :func:`validate_scene`: check everything;
* :func:`say_building`, :func:`end_building`, :func:`list_building`: what is being built beside it;
* :func:`change_labels`, :func:`read_labels`, :func:`read_names`, :class:`RegionNames`: what regions
  are called;
* :func:`change_strokes`, :func:`read_strokes`, :class:`Stroke`: what people painted on it, and
  :func:`read_taught`, :func:`write_taught`: what that has taught;
* :class:`SegmentIndex`, :class:`Cover`, :class:`Manifest`: what is in it;
* :class:`PackedRTree`: segments within a radius;
* :class:`PayloadSource` with :class:`FileSource`: the bytes of a pack;
* :class:`SceneFiles`, :func:`scene_files`: where a scene lies. Object storage is in
  :mod:`terraport_store.object_files`, which needs ``terraport[s3]``.
"""

from __future__ import annotations

from terraport_store.addresses import is_url, meant_url
from terraport_store.assembly import SceneInfo
from terraport_store.building import SceneBuilding, end_building, list_building, say_building
from terraport_store.cover import Cover
from terraport_store.errors import (
    CorruptPayloadError,
    DamagedSceneError,
    LabelError,
    OriginError,
    OutOfSpaceError,
    PublishError,
    RangeError,
    SceneBusyError,
    SceneNotFoundError,
    StoreError,
    StrokeError,
)
from terraport_store.files import FolderFiles, SceneFiles, open_inside, path_inside
from terraport_store.index import SegmentIndex
from terraport_store.labelling import change_labels, read_labels, read_names
from terraport_store.labels import MAX_LABEL_LENGTH, label_fault
from terraport_store.location import REACH_S, needing_obstore, scene_files
from terraport_store.manifest import (
    EAST_NORTH_UP,
    AttributeInfo,
    Axis,
    Bounds,
    BuildInfo,
    Counts,
    CrsInfo,
    EncodingInfo,
    FileInfo,
    HandOff,
    InputInfo,
    Limits,
    Manifest,
    SurveyUnits,
    TextureInfo,
    manifest_digest,
)
from terraport_store.opening import list_scenes, read_manifest
from terraport_store.packed_rtree import PackedRTree
from terraport_store.painting import change_strokes, read_strokes, read_taught, write_taught
from terraport_store.reader import Scene
from terraport_store.regions import RegionNames
from terraport_store.source import (
    FileSource,
    PayloadRange,
    PayloadSource,
    read_cached,
)
from terraport_store.strokes import Stroke, Strokes
from terraport_store.validate import Finding, validate_scene
from terraport_store.writer import SceneWriter

__all__ = [
    "EAST_NORTH_UP",
    "MAX_LABEL_LENGTH",
    "REACH_S",
    "AttributeInfo",
    "Axis",
    "Bounds",
    "BuildInfo",
    "CorruptPayloadError",
    "Counts",
    "Cover",
    "CrsInfo",
    "DamagedSceneError",
    "EncodingInfo",
    "FileInfo",
    "FileSource",
    "Finding",
    "FolderFiles",
    "HandOff",
    "InputInfo",
    "LabelError",
    "Limits",
    "Manifest",
    "OriginError",
    "OutOfSpaceError",
    "PackedRTree",
    "PayloadRange",
    "PayloadSource",
    "PublishError",
    "RangeError",
    "RegionNames",
    "Scene",
    "SceneBuilding",
    "SceneBusyError",
    "SceneFiles",
    "SceneInfo",
    "SceneNotFoundError",
    "SceneWriter",
    "SegmentIndex",
    "StoreError",
    "Stroke",
    "StrokeError",
    "Strokes",
    "SurveyUnits",
    "TextureInfo",
    "change_labels",
    "change_strokes",
    "end_building",
    "is_url",
    "label_fault",
    "list_building",
    "list_scenes",
    "manifest_digest",
    "meant_url",
    "needing_obstore",
    "open_inside",
    "path_inside",
    "read_cached",
    "read_labels",
    "read_manifest",
    "read_names",
    "read_strokes",
    "read_taught",
    "say_building",
    "scene_files",
    "validate_scene",
    "write_taught",
]
