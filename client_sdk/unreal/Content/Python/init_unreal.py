"""Create the plugin's materials when the editor starts, if the project has none yet.

Unreal runs the file of this name in the Python folder of each plugin. It waits until the editor has
loaded the list of assets. In a process without a window, such as the cooker, it does nothing.
"""

# ruff: noqa: INP001 - Unreal puts this folder on Python's path

from __future__ import annotations

import terraport_materials
import unreal


def make_when_known(_seconds: float) -> None:
    """Create the missing materials once, as soon as the list of assets is loaded."""
    if unreal.AssetRegistryHelpers.get_asset_registry().is_loading_assets():
        return
    unreal.unregister_slate_post_tick_callback(_callback)
    terraport_materials.make()


_callback = unreal.register_slate_post_tick_callback(make_when_known)
