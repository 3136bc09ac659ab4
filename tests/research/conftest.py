"""The small meshes of the geometry tests."""

from pipeline.geometry.conftest import terrain

__all__ = ["terrain"]
