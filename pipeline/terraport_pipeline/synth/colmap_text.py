"""Two texts beside COLMAP's cameras: points to check them by, and where their world lies.

The cameras themselves are written by :mod:`terraport_pipeline.engines.camera_files.write_colmap`.
PURE: returns text.

References
----------
COLMAP documentation, "Output format", https://colmap.github.io/format.html
"""

from __future__ import annotations

from terraport_payload.types import Float64, UInt8

__all__ = ["offset_text", "points_text"]


def points_text(points: Float64, colours: UInt8) -> str:
    """Return ``points3D.txt``: points (N, 3) of COLMAP's world, without tracks."""
    lines = [
        "# 3D point list with one line of data per point:",
        "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)",
        f"# Number of points: {len(points)}, mean track length: 0",
    ]
    for number, (point, colour) in enumerate(
        zip(points.tolist(), colours.tolist(), strict=True), start=1
    ):
        x, y, z = point
        red, green, blue = colour
        lines.append(f"{number} {x:.4f} {y:.4f} {z:.4f} {red} {green} {blue} 0")
    return "\n".join(lines) + "\n"


def offset_text(offset: Float64, epsg: int, survey: str) -> str:
    """Return ``OFFSET.txt``: how COLMAP's world lies in the CRS."""
    east, north, up = offset
    return (
        f"World = COLMAP coordinates + ({east:.6f} {north:.6f} {up:.6f}), EPSG:{epsg}, metres; "
        f"same frame as {survey}\n"
    )
