"""Profiles: what a build takes by default so that its scene fits the devices it is for.

Segment size, texel size and the form of textures go with the bounds that clients take for the same
class of device (radius, triangles, segments, GPU bytes): docs/topics/profiles.md has the reckoning.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, Literal

from terraport_pipeline.option import option_fields
from terraport_pipeline.options import texture

__all__ = ["PROFILES", "Profile", "texture_options"]

Profile = Literal["desktop", "headset", "phone"]

PROFILES: Final[Mapping[Profile, Mapping[str, Any]]] = {
    # What the options say without a profile.
    "desktop": {},
    # 900,000 triangles in at most 512 segments: smaller ones than 1,800 faces would be cut by the
    # count of segments first; 4,000 leave half of the draw calls free.
    "headset": {
        "min_faces": 4000,
        "max_faces": 16000,
        "texture_format": "ktx2",
        "texture_quality": 50,
        "texel_size": 0.01,
    },
    # A landing of 40 m at 2 cm is 21 million texels: 14 MB compressed, 112 MB as JPEG.
    "phone": {
        "min_faces": 4000,
        "max_faces": 16000,
        "texture_format": "ktx2",
        "texture_quality": 50,
        "texel_size": 0.02,
    },
}
"""Defaults by the command line's names of the options; what is stated stands before them."""


def texture_options(profile: Profile, options: texture.Options) -> texture.Options:
    """Put a profile's values into options of textures that nobody stated."""
    keys = {field.key: field.name for field in option_fields(texture.Options)}
    values = {keys[key]: value for key, value in PROFILES[profile].items() if key in keys}
    return replace(options, **values)
