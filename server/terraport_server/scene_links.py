"""Addresses that the service tells of: relative to its root, to hold behind any prefix."""

from __future__ import annotations

from typing import Any, Final

from terraport_server.scenes import ServedScene
from terraport_server.settings import Settings

__all__ = ["REPORT", "links_of", "service_links", "summary_of"]

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
    if served.fetchers is not None or (served.scene.path / REPORT).is_file():
        links["report"] = f"{root}/report"
    return links


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


def service_links(settings: Settings) -> dict[str, str]:
    """Return the pages beside the scenes that answer to anybody."""
    links = {"docs": settings.serves_docs, "metrics": settings.serves_metrics}
    return {name: name for name, served in links.items() if served}
