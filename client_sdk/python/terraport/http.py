"""HTTP requests of a client: manifest, base mesh, regions and labels.

Everything is asked for by version, so nothing that comes back ever changes: what the disk cache has
of a version is used without asking.
"""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

import httpx

from terraport.address import Access, SceneUrl
from terraport.backoff import why_unreached
from terraport.base import BaseMesh
from terraport.disk import DiskCache
from terraport.errors import HttpError, ProtocolViolationError, TerraportError, UsageError
from terraport.places import CoarserPiece, Place, coarser_pieces, places_of
from terraport_payload import AttributeScale, PayloadError

__all__ = ["Scales", "SceneHttp", "scales_of"]

Scales = Mapping[str, AttributeScale] | TerraportError
"""Scales of a scene version's attributes, or the error of the request for them."""

_MAX_BASE_BYTES: Final = 1 << 30
"""Largest base mesh that is read; one of 5 M faces takes about 60 MB."""
_MAX_MANIFEST_BYTES: Final = 16 << 20
_MAX_REGIONS_BYTES: Final = 256 << 20
"""Largest regions.json that a scene may have."""


class SceneHttp:
    """HTTP side of one session. Calls may overlap; cancelling one abandons its request.

    The owner calls :meth:`aclose`.

    Parameters
    ----------
    url : SceneUrl
        Of the server or the scene.
    access : Access
        Its token is sent to that server alone: redirects are not followed.
    timeout_s : float or None
        Bound on connecting, and on each wait for more bytes; None waits for ever.
    """

    def __init__(self, url: SceneUrl, access: Access, timeout_s: float | None) -> None:
        self._client = httpx.AsyncClient(timeout=timeout_s)
        self._access = access
        self._url = url

    async def resolve(self) -> SceneUrl:
        """Return the URL of the scene; a server URL stands for its only scene.

        Raises
        ------
        HttpError
            The server does not answer, or refuses.
        UsageError
            It has none, or more than one: then the error names them.
        """
        if self._url.scene is not None:
            return self._url
        ids = await self.scene_ids()
        if len(ids) != 1:
            named = ", ".join(ids) or "none"
            raise UsageError(
                f"{self._url.server} serves {len(ids)} scenes ({named}), "
                "expected one: name it as .../scenes/ID"
            )
        self._url = self._url.with_scene(ids[0])
        return self._url

    async def scene_ids(self) -> list[str]:
        """Return the ids of the server's scenes, as far as the token opens them.

        Raises
        ------
        HttpError
            The server does not answer, or refuses.
        """
        document = await self._json(self._url.scenes)
        try:
            return [str(scene["id"]) for scene in document["scenes"]]
        except (KeyError, TypeError):
            raise ProtocolViolationError(f"{self._url.scenes} lists no scenes") from None

    async def manifest(self, version: str | None = None) -> dict[str, Any]:
        """Return the scene's manifest as ``spec/scene-format.md`` section 4 has it.

        Parameters
        ----------
        version : str or None
            None asks for the newest.

        Raises
        ------
        HttpError
            The server does not answer, or does not have that version any more.
        """
        return await self._json(self._url.http, version)

    async def base(
        self, version: str, disk: DiskCache | None, keep: Callable[[], frozenset[int]]
    ) -> BaseMesh:
        """Return the base mesh, from the disk cache where that has it.

        Parameters
        ----------
        version : str
        disk : DiskCache or None
        keep : callable
            Returns the keys that the disk must not delete to make room.

        Raises
        ------
        HttpError
            The server does not answer, or does not have that version any more.
        ProtocolViolationError
            What came cannot be decoded.
        """
        manifest = await self.manifest(version)
        scales = scales_of(manifest)
        xxh3 = manifest.get("files", {}).get("base.tsg", {}).get("xxh3")
        name = re.sub(r"\W", "", str(xxh3 or version))
        data = None if disk is None else await asyncio.to_thread(disk.get_base, name)
        if data is None:
            data = await self._get(f"{self._url.http}/base.tsg", version, _MAX_BASE_BYTES)
            if disk is not None:
                await asyncio.to_thread(disk.put_base, name, data, keep())
        return await asyncio.to_thread(BaseMesh.of, version, data, scales)

    async def places(self, version: str) -> tuple[Place, ...]:
        """Return the named regions of a version, under the names that they have now.

        Raises
        ------
        HttpError
            The server does not answer, or does not have that version any more.
        """
        return places_of(*await self._regions(version))

    async def coarser(self, version: str, region: int) -> tuple[CoarserPiece, ...]:
        """Return the coarser pieces of a version that a region is part of.

        Raises
        ------
        HttpError
            The server does not answer, or does not have that version any more.
        """
        return coarser_pieces(*await self._regions(version), region)

    async def aclose(self) -> None:
        """Close all connections."""
        await self._client.aclose()

    async def _regions(self, version: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return contents of regions.json, and of labels.json as it is now."""
        url, most = self._url.http, _MAX_REGIONS_BYTES
        regions = await self._json(f"{url}/regions.json", version, max_bytes=most)
        return regions, await self._json(f"{url}/labels.json", max_bytes=most)

    async def _json(
        self, url: str, version: str | None = None, *, max_bytes: int | None = None
    ) -> dict[str, Any]:
        data = await self._get(url, version, max_bytes or _MAX_MANIFEST_BYTES)
        try:
            document = json.loads(data)
        except ValueError as error:
            raise HttpError(url, 200, f"no JSON: {error}") from None
        if not isinstance(document, dict):
            raise HttpError(url, 200, f"got {type(document).__name__}, expected an object")
        return document

    async def _get(self, url: str, version: str | None, max_bytes: int) -> bytes:
        chunks, size = [], 0
        try:
            async with self._client.stream(
                "GET",
                url,
                params=None if version is None else {"v": version},
                headers=self._access.headers(),
            ) as response:
                async for chunk in response.aiter_bytes():
                    size += len(chunk)
                    if size > max_bytes:
                        text = f"more than {max_bytes} bytes"
                        raise HttpError(url, response.status_code, text)
                    chunks.append(chunk)
                if response.status_code != httpx.codes.OK:
                    text = _error_text(b"".join(chunks), response.reason_phrase)
                    raise HttpError(url, response.status_code, text)
        except httpx.HTTPError as error:
            raise HttpError(url, 0, why_unreached(error)) from error
        return b"".join(chunks)


def _error_text(body: bytes, reason: str) -> str:
    """Return the message of the server's JSON error body, or the status line's words."""
    try:
        return str(json.loads(body)["error"]["message"])
    except (ValueError, KeyError, TypeError):
        return reason or "no reason given"


def scales_of(manifest: Mapping[str, Any]) -> dict[str, AttributeScale]:
    """Return the scales of the attributes, in the manifest's order.

    Raises
    ------
    ProtocolViolationError
        The manifest's ``attributes`` are not as the format says.
    """
    try:
        return {
            str(row["name"]): AttributeScale(float(row["offset"]), float(row["step"]))
            for row in manifest.get("attributes", ())
        }
    except (KeyError, TypeError, ValueError, PayloadError) as error:
        raise ProtocolViolationError(f"manifest: wrong attributes ({error!r})") from None
