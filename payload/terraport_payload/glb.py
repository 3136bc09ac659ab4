"""The ``glb`` payload: one mesh as a self-contained glTF 2.0 binary.

One node, one mesh, one primitive; the profile is in ``spec/scene-format.md``, section "GLB
payload". Encoding lives in :mod:`~terraport_payload.glb_encode`, decoding in
:mod:`~terraport_payload.glb_decode`.

PURE: no I/O, no clock.
"""

from __future__ import annotations

from terraport_payload.glb_decode import decode_glb
from terraport_payload.glb_encode import encode_glb, gltf_attribute_name

__all__ = ["decode_glb", "encode_glb", "gltf_attribute_name"]
