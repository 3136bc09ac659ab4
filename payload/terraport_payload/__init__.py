"""Payload codecs: one segment, or the base mesh, between arrays and bytes.

A segment is stored and sent in segment format 2 (:func:`encode_segment`, :func:`decode_segment`;
``spec/segment-format.md``), the base mesh as a self-contained glTF 2.0 binary, quantised and
meshopt-compressed (:func:`encode_glb`, :func:`decode_glb`; ``spec/scene-format.md``, section 9).

PURE: no I/O, no clock; depends on NumPy, meshopt, orjson and xxhash alone. Every
function is thread-safe.
"""

from __future__ import annotations

from terraport_payload.boxes import box_distances_m
from terraport_payload.cover import Cover
from terraport_payload.errors import PayloadError
from terraport_payload.glb import decode_glb, encode_glb, gltf_attribute_name
from terraport_payload.glb_texture import snap_uvs
from terraport_payload.grid import AttributeScale, choose_attribute_scale, choose_step_m, snap
from terraport_payload.mesh import SegmentMesh
from terraport_payload.order import order_for_cache
from terraport_payload.segment_format import decode_segment, encode_segment, segment_bounds
from terraport_payload.texture import Texture

__all__ = [
    "AttributeScale",
    "Cover",
    "PayloadError",
    "SegmentMesh",
    "Texture",
    "box_distances_m",
    "choose_attribute_scale",
    "choose_step_m",
    "decode_glb",
    "decode_segment",
    "encode_glb",
    "encode_segment",
    "gltf_attribute_name",
    "order_for_cache",
    "segment_bounds",
    "snap",
    "snap_uvs",
]
