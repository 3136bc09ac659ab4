"""Links of responses, relative to the server URL so that they are valid behind any prefix."""

from __future__ import annotations

import contextlib
from typing import Any, Final
from urllib.parse import quote

from terraport_server.scenes.served_scene import ServedScene
from terraport_server.settings import Settings
from terraport_store import SceneBuilding, path_inside
from terraport_store.layout import BASE, OVERVIEW, PREVIEW, REPORT, REPORT_PDF

__all__ = [
    "building_line",
    "has_local_file",
    "links_of",
    "scene_line",
    "scene_path",
    "service_links",
]

_BUILD_FILES: Final = (
    ("report", "report", REPORT),
    ("report_pdf", REPORT_PDF, REPORT_PDF),
    ("preview", PREVIEW, PREVIEW),
)
"""Link, last part of its address, and file."""


def scene_path(scene_id: str) -> str:
    """Return the address of a scene relative to the server URL, percent-encoded (RFC 3986)."""
    return f"scenes/{quote(scene_id, safe='')}"


def links_of(served: ServedScene) -> dict[str, str]:
    """Return the links of a scene.

    Those to the build's report and preview are included where the file exists, and always for a
    scene in object storage, where that is not known without a request.
    """
    root, query = scene_path(served.id), f"?v={served.version}"
    links = {
        "self": root,
        "stream": f"{root}/stream",
        "base": f"{root}/{BASE}{query}",
        "regions": f"{root}/regions.json{query}",
        "labels": f"{root}/labels.json",
        "segment": f"{root}/segments/{{segment}}.glb{query}",
        "tileset": f"{root}/tileset.json",
    }
    if OVERVIEW in served.scene.manifest.files:
        links["overview"] = f"{root}/{OVERVIEW}{query}"
    names: set[str] = set()
    if served.fetchers is None:
        with contextlib.suppress(OSError):  # the folder was deleted
            names = {path.name for path in served.scene.path.iterdir()}
    for link, path, name in _BUILD_FILES:
        if served.fetchers is not None or (name in names and has_local_file(served, name)):
            links[link] = f"{root}/{path}"
    return links


def scene_line(served: ServedScene) -> dict[str, Any]:
    """Return the line of a scene in the list of scenes."""
    manifest = served.scene.manifest
    return {
        "id": served.id,
        "name": manifest.name,
        "version": served.version,
        "segments": manifest.counts.segments,
        "detail_faces": manifest.counts.detail_faces,
        "links": links_of(served),
    }


def has_local_file(served: ServedScene, name: str) -> bool:
    """Return whether the scene's local folder has a file of this name."""
    try:
        return path_inside(served.scene.path, name).is_file()
    except OSError:
        return False


def building_line(build: SceneBuilding) -> dict[str, Any]:
    """Return the line of a scene that is being built."""
    line: dict[str, Any] = {"id": build.id, "name": build.name, "step": build.step}
    return line if build.share is None else line | {"share": build.share}


def service_links(settings: Settings) -> dict[str, str]:
    """Return the links of the service that need no token."""
    links = {"docs": settings.serves_docs, "metrics": settings.serves_metrics}
    return {name: name for name, served in links.items() if served}
