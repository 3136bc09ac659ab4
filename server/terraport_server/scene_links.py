"""Addresses that the service tells of: relative to its root, to hold behind any prefix."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from terraport_server.scenes import ServedScene
from terraport_server.settings import Settings
from terraport_store import SceneBuilding, path_inside

__all__ = ["REPORT", "building_line", "links_of", "report_of", "service_links", "summary_of"]

REPORT: Final = "report.html"
"""What ``terraport report`` writes beside ``scene.json``."""


def links_of(served: ServedScene) -> dict[str, str]:
    """Return the addresses of a scene's parts.

    ``report`` is among them where there is one, and for a scene in object storage always: whether
    there is one is not known without asking there.
    """
    root, query = f"scenes/{served.id}", f"?v={served.version}"
    links = {
        "self": root,
        "stream": f"{root}/stream",
        "base": f"{root}/base.glb{query}",
        "cover": f"{root}/base.cover{query}",
        "regions": f"{root}/regions.json{query}",
        "labels": f"{root}/labels.json",
        "segment": f"{root}/segments/{{segment}}.glb{query}",
    }
    if served.fetchers is not None or report_of(served) is not None:
        links["report"] = f"{root}/report"
    return links


def report_of(served: ServedScene) -> Path | None:
    """Return the path of the report where it is a file of the scene, and local."""
    try:
        path = path_inside(served.scene.path, REPORT)
    except OSError:
        return None
    return path if path.is_file() else None


def summary_of(served: ServedScene) -> dict[str, Any]:
    """Return the line of a scene in the list of all."""
    manifest = served.scene.manifest
    return {
        "id": served.id,
        "name": manifest.name,
        "version": served.version,
        "segments": manifest.counts.segments,
        "detail_faces": manifest.counts.detail_faces,
        "links": links_of(served),
    }


def building_line(build: SceneBuilding) -> dict[str, Any]:
    """Return the line of a scene that is being built."""
    line: dict[str, Any] = {"id": build.id, "name": build.name, "step": build.step}
    return line if build.share is None else line | {"share": build.share}


def service_links(settings: Settings) -> dict[str, str]:
    """Return the pages beside the scenes that answer to anybody."""
    links = {"docs": settings.serves_docs, "metrics": settings.serves_metrics}
    return {name: name for name, served in links.items() if served}
