"""Scene directories: read, write, check.

A scene is a directory that is published atomically; format in ``spec/scene-format.md``.

* :class:`Scene` (``Scene.open``), :func:`list_scenes`, :func:`read_manifest`: read;
* :class:`SceneWriter`: write a new version and publish it;
* :func:`validate_scene`: check everything;
* :func:`change_labels`, :func:`read_labels`, :func:`read_names`, :class:`RegionNames`: what regions
  are called;
* :class:`SegmentIndex`, :class:`Cover`, :class:`Manifest`: what is in it;
* :class:`SpatialIndex` with :class:`RTreeIndex` and :class:`BruteForceIndex`: segments within a
  radius;
* :class:`PayloadSource` with :class:`FileSource`, :class:`MmapSource`, :class:`MemorySource`.
"""

from __future__ import annotations

from terraport_store.assembly import SceneInfo
from terraport_store.cover import Cover
from terraport_store.errors import (
    CorruptPayloadError,
    DamagedSceneError,
    LabelError,
    OutOfSpaceError,
    PublishError,
    RangeError,
    SceneBusyError,
    SceneNotFoundError,
    StoreError,
)
from terraport_store.index import SegmentIndex
from terraport_store.labelling import change_labels, read_labels, read_names
from terraport_store.labels import MAX_LABEL_LENGTH, label_fault
from terraport_store.manifest import (
    AttributeInfo,
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
    TextureInfo,
    manifest_digest,
)
from terraport_store.reader import Scene, list_scenes, read_manifest
from terraport_store.regions import RegionNames
from terraport_store.source import FileSource, MemorySource, MmapSource, PayloadRange, PayloadSource
from terraport_store.spatial import BruteForceIndex, RTreeIndex, SpatialIndex, box_distances_m
from terraport_store.validate import Finding, validate_scene
from terraport_store.writer import SceneWriter

__all__ = [
    "MAX_LABEL_LENGTH",
    "AttributeInfo",
    "Bounds",
    "BruteForceIndex",
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
    "HandOff",
    "InputInfo",
    "LabelError",
    "Limits",
    "Manifest",
    "MemorySource",
    "MmapSource",
    "OutOfSpaceError",
    "PayloadRange",
    "PayloadSource",
    "PublishError",
    "RTreeIndex",
    "RangeError",
    "RegionNames",
    "Scene",
    "SceneBusyError",
    "SceneInfo",
    "SceneNotFoundError",
    "SceneWriter",
    "SegmentIndex",
    "SpatialIndex",
    "StoreError",
    "TextureInfo",
    "box_distances_m",
    "change_labels",
    "label_fault",
    "list_scenes",
    "manifest_digest",
    "read_labels",
    "read_manifest",
    "read_names",
    "validate_scene",
]
