"""A scene as 3D Tiles 1.1 (OGC 22-025r4), for other viewers: one writer, for files and service.

See docs/topics/tiles.md for what is under what, and why nobody sees a hole.
"""

__all__: list[str] = []
