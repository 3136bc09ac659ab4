"""Addresses that the service tells of: relative to its root, to hold behind any prefix."""

from __future__ import annotations

import json
from typing import Any, Final
from urllib.parse import quote

from terraport_server.scenes.served_scene import ServedScene
from terraport_server.settings import Settings
from terraport_store import SceneBuilding, path_inside
from terraport_store.layout import OVERVIEW, PREVIEW, REPORT, REPORT_PDF

__all__ = [
    "building_line",
    "has_local_file",
    "links_of",
    "scene_path",
    "service_links",
    "summary_of",
]

_SAID_BY_BUILDS: Final = (
    ("report", "report", REPORT),
    ("report_pdf", REPORT_PDF, REPORT_PDF),
    ("preview", PREVIEW, PREVIEW),
)
"""Link, last part of its address, and file."""


def scene_path(scene_id: str) -> str:
    """Return the address of a scene relative to the server URL, percent-encoded (RFC 3986)."""
    return f"scenes/{quote(scene_id, safe='')}"


def links_of(served: ServedScene) -> dict[str, str]:
    """Return the addresses of a scene's parts; not to be changed.

    Those of what a build says of the scene are among them where there is a file of it, and for a
    scene in object storage always: whether there is one is not known without asking there.
    """
    return _said_of(served)[0]


def summary_of(served: ServedScene) -> bytes:
    """Return the line of a scene in the list of all, as JSON."""
    return _said_of(served)[1]


def _said_of(served: ServedScene) -> tuple[dict[str, str], bytes]:
    """Return links and line; looked for anew where something came to the scene's folder, or went.

    Of ten thousand scenes three files each would be looked for whenever somebody lists them.
    """
    return served.while_folder_rests(lambda: _find(served))


def _find(served: ServedScene) -> tuple[dict[str, str], bytes]:
    links = _find_links(served)
    manifest = served.scene.manifest
    summary = {
        "id": served.id,
        "name": manifest.name,
        "version": served.version,
        "segments": manifest.counts.segments,
        "detail_faces": manifest.counts.detail_faces,
        "links": links,
    }
    return links, json.dumps(summary, ensure_ascii=False, separators=(",", ":")).encode()


def _find_links(served: ServedScene) -> dict[str, str]:
    root, query = scene_path(served.id), f"?v={served.version}"
    links = {
        "self": root,
        "stream": f"{root}/stream",
        "base": f"{root}/base.glb{query}",
        "cover": f"{root}/base.cover{query}",
        "regions": f"{root}/regions.json{query}",
        "labels": f"{root}/labels.json",
        "segment": f"{root}/segments/{{segment}}.glb{query}",
        "tileset": f"{root}/tileset.json",
    }
    if OVERVIEW in served.scene.manifest.files:
        links["overview"] = f"{root}/{OVERVIEW}{query}"
    for link, path, name in _SAID_BY_BUILDS:
        if served.fetchers is not None or has_local_file(served, name):
            links[link] = f"{root}/{path}"
    return links


def has_local_file(served: ServedScene, name: str) -> bool:
    """Tell whether a build left a file of this name that is of the scene, and local."""
    try:
        return path_inside(served.scene.path, name).is_file()
    except OSError:
        return False


def building_line(build: SceneBuilding) -> dict[str, Any]:
    """Return the line of a scene that is being built."""
    line: dict[str, Any] = {"id": build.id, "name": build.name, "step": build.step}
    return line if build.share is None else line | {"share": build.share}


def service_links(settings: Settings) -> dict[str, str]:
    """Return the pages beside the scenes that answer to anybody."""
    links = {"docs": settings.serves_docs, "metrics": settings.serves_metrics}
    return {name: name for name, served in links.items() if served}
