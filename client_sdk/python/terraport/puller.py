"""Payload fetched over HTTP, for a session that pulls (wire protocol, section 17).

Lives on the session's event loop. What to fetch is decided elsewhere: each :meth:`Puller.want`
replaces what was wanted before. Requests under way that bring something still wanted go on, the
others are cancelled.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

import httpx

from terraport.access import Access
from terraport.pull_ranges import Fetch, PackAddress, PackRange, merge_ranges, part_of_content_range
from terraport.unreached import why_unreached

__all__ = ["Puller"]

REQUESTS: Final = 3
"""Under way at once: one fills the gaps between the answers of the others."""

ATTEMPTS: Final = 2
"""At each range, before the pack counts as out of reach; what came of the first is kept."""

_log = logging.getLogger("terraport")


class _Unreached(Exception):  # noqa: N818 - never leaves the module
    """Why a range did not come."""


class Puller:
    """Fetches payloads by merged ranges. The owner awaits :meth:`aclose`.

    Parameters
    ----------
    access : Access
        Its token is sent to the scene's own server alone; redirects are not followed.
    timeout_s : float or None
        Bound on connecting, and on each wait for more bytes.
    arrived : callable
        Takes segment and payload, unchecked.
    told : callable
        Called when a range is whole, or has ended.
    lost : callable
        Takes why a range cannot be had; nothing is fetched from then on, until :meth:`want`.
    """

    def __init__(
        self,
        access: Access,
        timeout_s: float | None,
        *,
        arrived: Callable[[int, bytes], None],
        told: Callable[[], None],
        lost: Callable[[str], None],
    ) -> None:
        self.requests = 0
        """Requests made, over the whole session."""
        self.received_bytes = 0
        """Bytes of bodies received, over the whole session."""
        self._access = access
        self._timeout_s = timeout_s
        self._arrived = arrived
        self._told = told
        self._lost = lost
        self._client: httpx.AsyncClient | None = None
        self._address: PackAddress | None = None
        self._queue: deque[PackRange] = deque()
        self._under_way: dict[asyncio.Task[None], set[int]] = {}
        """Segments that each request is still to bring."""
        self._ended: set[asyncio.Task[None]] = set()
        """Cancelled, and not over yet."""

    def want(self, address: PackAddress, fetches: Sequence[Fetch]) -> None:
        """Fetch these, the most urgent first, and nothing else."""
        wanted = {fetch.segment for fetch in fetches}
        if address != self._address:
            self._address = address
            wanted_here: set[int] = set()
        else:
            wanted_here = wanted
        coming: set[int] = set()
        for task, segments in list(self._under_way.items()):
            if segments & wanted_here:
                coming |= segments
            else:
                self._cancel(task)
        self._queue = deque(
            merge_ranges([fetch for fetch in fetches if fetch.segment not in coming])
        )
        self._start()

    def stop(self) -> None:
        """Fetch nothing more; what is under way is cancelled."""
        self._queue.clear()
        for task in list(self._under_way):
            self._cancel(task)

    async def aclose(self) -> None:
        """Stop, and close the connections."""
        self.stop()
        await asyncio.gather(*self._ended, return_exceptions=True)
        if self._client is not None:
            await self._client.aclose()

    def _cancel(self, task: asyncio.Task[None]) -> None:
        del self._under_way[task]
        self._ended.add(task)
        task.cancel()

    def _start(self) -> None:
        while self._queue and len(self._under_way) < REQUESTS:
            pack_range = self._queue.popleft()
            segments = {fetch.segment for fetch in pack_range.fetches}
            assert self._address is not None
            work = self._bring(self._address, pack_range, segments)
            task = asyncio.create_task(work, name="terraport-pull")
            self._under_way[task] = segments
            task.add_done_callback(self._on_done)

    def _on_done(self, task: asyncio.Task[None]) -> None:
        self._ended.discard(task)
        if self._under_way.pop(task, None) is None:
            return  # cancelled: nobody waits for it
        error = None if task.cancelled() else task.exception()
        if error is None:
            self._start()
            self._told()
            return
        self.stop()
        text = str(error) if isinstance(error, _Unreached) else f"a fault of the client: {error!r}"
        _log.warning("payload cannot be fetched: %s", text)
        self._lost(text)

    async def _bring(self, address: PackAddress, pack_range: PackRange, waiting: set[int]) -> None:
        """Fetch one range; what an attempt left out is asked for by the next."""
        for attempt in range(1, ATTEMPTS + 1):
            left = [fetch for fetch in pack_range.fetches if fetch.segment in waiting]
            if not left:
                return
            try:
                await self._fetch(address, left, waiting)
            except (_Unreached, httpx.HTTPError) as error:
                if attempt == ATTEMPTS:
                    text = why_unreached(error) if isinstance(error, httpx.HTTPError) else error
                    raise _Unreached(f"{address.url}: {text}") from error

    async def _fetch(self, address: PackAddress, fetches: list[Fetch], waiting: set[int]) -> None:
        """Ask once, and hand on each payload as soon as it is whole."""
        start, end = fetches[0].offset, fetches[-1].offset + fetches[-1].length
        headers = {"Range": f"bytes={start}-{end - 1}", "Accept-Encoding": "identity"}
        if address.is_ours:
            headers |= self._access.headers()
        if self._client is None:
            limits = httpx.Limits(max_connections=REQUESTS)
            self._client = httpx.AsyncClient(timeout=self._timeout_s, limits=limits)
        self.requests += 1
        async with self._client.stream("GET", address.url, headers=headers) as response:
            if response.status_code != httpx.codes.PARTIAL_CONTENT:
                raise _Unreached(f"got status {response.status_code}, expected 206")
            part = part_of_content_range(response.headers.get("content-range", ""))
            if part != (start, end, address.total):
                got = response.headers.get("content-range", "none")[:64]
                expected = f"bytes {start}-{end - 1}/{address.total}"
                raise _Unreached(f"got Content-Range {got}, expected {expected}")
            data = bytearray()
            at, pending = start, deque(fetches)
            async for piece in response.aiter_raw():
                self.received_bytes += len(piece)
                data += piece
                while pending and at + len(data) >= pending[0].offset + pending[0].length:
                    fetch = pending.popleft()
                    skipped = fetch.offset - at
                    payload = bytes(data[skipped : skipped + fetch.length])
                    del data[: skipped + fetch.length]
                    at = fetch.offset + fetch.length
                    waiting.discard(fetch.segment)
                    self._arrived(fetch.segment, payload)
                if data and not pending:
                    return  # more than was asked for: the connection is left with it
            if pending:
                raise _Unreached(f"the answer ended {end - at - len(data)} bytes too soon")
