"""Make the plugin's materials when the editor starts, where the project has none yet.

Unreal runs a file of this name in each plugin's Python folder. It waits until the editor knows the
project's assets. Without a window, as in the cooker, nothing is made.
"""

# ruff: noqa: INP001 - Unreal puts this folder on Python's path

from __future__ import annotations

import terraport_materials
import unreal


def make_when_known(_seconds: float) -> None:
    """Make what is missing, once, as soon as the assets are known."""
    if unreal.AssetRegistryHelpers.get_asset_registry().is_loading_assets():
        return
    unreal.unregister_slate_post_tick_callback(_callback)
    terraport_materials.make()


_callback = unreal.register_slate_post_tick_callback(make_when_known)
