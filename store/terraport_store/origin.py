"""Object storage as this package uses it: whole objects, ranges, heads, lists, by ``obstore``.

One :class:`Origin` is one place (a bucket and a prefix). Every request is tried again while that
makes sense, with growing pauses and within a bounded time; what came of it is counted. obstore's
own retries are off, because they can be neither counted nor interrupted.

Needs ``terraport[s3]``; nothing else in this package does.
"""

from __future__ import annotations

import os
import random
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar
from urllib.parse import urlsplit

import obstore
from obstore.exceptions import (
    BaseError,
    InvalidPathError,
    NotSupportedError,
    PermissionDeniedError,
    UnauthenticatedError,
)
from obstore.store import HTTPStore, LocalStore, MemoryStore, S3Store, from_url

from terraport_store.errors import OriginError, StoreError

if TYPE_CHECKING:
    from obstore.store import ClientConfig, RetryConfig, S3Config  # there for type checkers alone

__all__ = ["Listed", "ObjectCounts", "ObjectOptions", "Origin", "Seen"]

_FIRST_PAUSE_S: Final = 0.1
_LONGEST_PAUSE_S: Final = 2.0
_CONNECT_S: Final = 3.0

_FINAL: Final = (
    PermissionDeniedError,
    UnauthenticatedError,
    InvalidPathError,
    NotSupportedError,
    ValueError,
)
"""Errors that the next attempt would meet again."""

_STATUS: Final = re.compile(r"status code: (\d{3})")
_NO_ANSWER: Final = re.compile(r"performing \w+ (https?://[^/\s]+)\S* in .*error sending request")
_ROLE_SERVICES: Final = ("//169.254.169.254", "//169.254.170.2")
"""Where Amazon's machines and containers ask for their credentials: others have none there."""
_WORTH_ANOTHER_TRY: Final = frozenset({408, 425, 429})

_Store = S3Store | HTTPStore | LocalStore | MemoryStore | Any
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class ObjectOptions:
    """How object storage is used; docs/topics/settings.md has some of these."""

    endpoint: str | None = None
    """Address of the S3 service; AWS_ENDPOINT_URL or Amazon's by default."""
    region: str | None = None
    """AWS_REGION or us-east-1 by default."""
    cache_dir: Path | None = None
    """Folder of the cache; None = in memory alone."""
    cache_bytes: int = 8 << 30
    """Bound of the cache on disk."""
    memory_bytes: int = 64 << 20
    """Bound of payloads in memory, where the disk takes none."""
    requests: int = 16
    """Requests under way at once to one scene, and as many again ahead of time."""
    read_ahead_bytes: int = 8 << 20
    """What one landing is read ahead at most; 0 = nothing."""
    timeout_s: float = 20.0
    """No attempt begins later than so long after the first, and none takes longer."""

    part_retries: int = 0
    """Times that a part of an upload is tried again."""

    @property
    def stall_s(self) -> float:
        """Silence in the middle of an answer after which the attempt is given up."""
        return self.timeout_s / 4.0

    @property
    def cool_down_s(self) -> float:
        """How long a place that gave nothing at all is left alone.

        Whoever asks meanwhile is told so at once, instead of waiting out every retry for each of
        200 segments.
        """
        return self.timeout_s / 4.0


class ObjectCounts:
    """What was asked of object storage, and what the caches saved. Any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.requests = 0
        """Attempts, the repeated ones included."""
        self.retries = 0
        """Attempts that were repeated."""
        self.failures = 0
        """Reads given up."""
        self.bytes = 0
        """Received."""
        self.payloads_fetched = 0
        self.payloads_from_disk = 0
        """Found in the cache on disk (opened and checked, or known to be there)."""
        self.wrong = 0
        """Payloads whose hash was wrong, from wherever."""
        self.uncached = 0
        """Payloads that the cache on disk did not take."""

    def add(self, **what: int) -> None:
        """Add numbers to the counters of these names; any thread may."""
        with self._lock:
            for name, number in what.items():
                setattr(self, name, getattr(self, name) + number)


@dataclass(frozen=True, slots=True)
class Seen:
    """What a head says of an object."""

    size: int
    stamp: str
    """Another one when the object was replaced: its ETag, or time and size."""
    attributes: dict[str, str]


@dataclass(frozen=True, slots=True)
class Listed:
    """What a list says of an object."""

    path: str
    size: int
    modified: datetime
    """When it was written; UTC."""


class Origin:
    """One place in object storage. Any thread.

    Parameters
    ----------
    url : str
        ``s3://BUCKET/PREFIX``, ``https://...``, ``file:///...`` and what else obstore knows.
    options : ObjectOptions
    counts : ObjectCounts, optional
        Counts also for others.
    store : optional
        An obstore store to use in place of one made from the URL.

    Raises
    ------
    OriginError
        When the URL is none that can be read.
    """

    def __init__(
        self,
        url: str,
        options: ObjectOptions,
        counts: ObjectCounts | None = None,
        *,
        store: _Store | None = None,
    ) -> None:
        self.url = url.rstrip("/")
        self.options = options
        self.counts = counts or ObjectCounts()
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self._worked_s = 0.0
        self._failed_s: float | None = None
        try:
            self._store = store if store is not None else _make_store(self.url, options)
        except (BaseError, ValueError) as error:
            may_come = url.startswith("file:")  # a folder that is not mounted yet
            what = f"cannot be used: {_said(error)}"
            raise OriginError(url, what, passing=may_come) from None

    def twin(self) -> Origin:
        """Return the same place once more, to be interrupted by itself."""
        return Origin(self.url, self.options, self.counts, store=self._store)

    def get(self, path: str, limit: int) -> bytes:
        """Read a whole object, ``limit`` + 1 bytes of it at most.

        Raises
        ------
        FileNotFoundError
            When there is none.
        OriginError
            When it cannot be read.
        """

        def attempt() -> bytes:
            out = bytearray()
            result = obstore.get(self._store, path)
            for block in result.stream(min_chunk_size=1 << 20):
                out += block
                if len(out) > limit:
                    break
            else:
                if len(out) != result.meta["size"]:
                    raise OSError(f"{len(out)} bytes came, expected {result.meta['size']}")
            return bytes(out[: limit + 1])

        data = self._tried(path, attempt)
        self.counts.add(bytes=len(data))
        return data

    def range(self, path: str, offset: int, length: int) -> bytes:
        """Read exactly ``length`` bytes, > 0; raises as :meth:`get`."""

        def attempt() -> bytes:
            data = bytes(obstore.get_range(self._store, path, start=offset, length=length))
            if len(data) != length:
                raise OSError(f"{len(data)} bytes at {offset} came, expected {length}")
            return data

        data = self._tried(path, attempt)
        self.counts.add(bytes=length)
        return data

    def blocks(self, path: str, size: int) -> Iterator[bytes]:
        """Read an object of ``size`` bytes from end to end, 4 MiB at a time; raises as above."""
        step = 4 << 20
        for offset in range(0, size, step):
            yield self.range(path, offset, min(step, size - offset))

    def head(self, path: str) -> Seen | None:
        """Look at an object; None where there is none. Raises OriginError as above."""
        try:
            result = self._tried(
                path, lambda: obstore.get(self._store, path, options={"head": True})
            )
        except FileNotFoundError:
            return None
        meta = result.meta
        stamp = meta.get("e_tag") or f"{meta['last_modified'].timestamp()}-{meta['size']}"
        attributes = {str(name).lower(): str(value) for name, value in result.attributes.items()}
        return Seen(int(meta["size"]), str(stamp), attributes)

    def folders(self) -> list[str]:
        """Names of the folders here, ascending. Raises OriginError as above."""
        listing = self._tried("", lambda: obstore.list_with_delimiter(self._store))
        return sorted(
            str(prefix).rstrip("/").rpartition("/")[2] for prefix in listing["common_prefixes"]
        )

    def objects(self, folder: str = "") -> list[Listed]:
        """List all objects in a folder and those in it, by path. Raises OriginError as above."""

        def attempt() -> list[Listed]:
            pages = obstore.list(self._store, prefix=f"{folder}/" if folder else None)
            rows = (meta for page in pages for meta in page)
            listed = (Listed(str(r["path"]), int(r["size"]), r["last_modified"]) for r in rows)
            return sorted(listed, key=lambda one: one.path)

        return self._tried(folder, attempt)

    def copy(self, source: str, target: str) -> None:
        """Copy an object within the storage, by the storage itself; raises as :meth:`get`."""
        self._tried(source, lambda: obstore.copy(self._store, source, target, overwrite=True))

    def put(self, path: str, data: bytes, attributes: dict[str, str] | None = None) -> None:
        """Write an object; tried again ``part_retries`` times.

        Raises
        ------
        OriginError
            When it cannot be written; what was there before stands.
        """
        with self._named(path):
            self._put(path, data, len(data) + 1, attributes)

    def put_parts(
        self, path: str, parts: Iterator[bytes], part_bytes: int, attributes: dict[str, str]
    ) -> None:
        """Write an object in parts, each tried again ``part_retries`` times.

        Raises
        ------
        OriginError
            When it cannot be written; what was there before stands.
        StoreError
            Whatever the iterator raises.
        """
        wrong: list[StoreError] = []

        def watched() -> Iterator[bytes]:
            try:
                yield from parts
            except StoreError as error:  # obstore would tell it as its own
                wrong.append(error)
                raise

        try:
            with self._named(path):
                self._put(path, watched(), part_bytes, attributes)
        except (OriginError, StoreError):
            if wrong:
                raise wrong[0] from None
            raise

    def _put(
        self, path: str, data: Any, part_bytes: int, attributes: dict[str, str] | None
    ) -> None:
        sizes: dict[str, Any] = {"chunk_size": part_bytes, "max_concurrency": 4}
        try:
            obstore.put(self._store, path, data, attributes=attributes or {}, **sizes)
        except FileNotFoundError:
            what = "cannot be written there, expected a bucket that exists"
            raise OriginError(f"{self.url}/{path}", what, passing=False) from None
        except NotSupportedError:
            if not attributes or not isinstance(data, bytes):
                raise
            obstore.put(self._store, path, data, **sizes)  # a folder has no metadata

    def delete(self, paths: list[str]) -> None:
        """Delete objects. Raises OriginError as above."""
        self._tried("", lambda: obstore.delete(self._store, paths))

    def interrupt(self) -> None:
        """Let what waits fail soon, now and from now on."""
        self._closing.set()

    def _tried(self, path: str, attempt: Callable[[], _T]) -> _T:
        """Call until it works, or trying makes no sense, or time is up."""
        began_s = time.monotonic()
        patient = self._may_ask(path, began_s)
        pause_s = _FIRST_PAUSE_S
        tries = 0
        while True:
            tries += 1
            self.counts.add(requests=1, retries=int(tries > 1))
            try:
                with self._named(path):
                    result = attempt()
            except FileNotFoundError:
                self._note_end(worked=True, now_s=time.monotonic())
                raise
            except OriginError as error:
                late = time.monotonic() - began_s + pause_s > self.options.timeout_s
                final = not error.passing
                if final or late or not patient or self._closing.is_set():
                    self._note_end(worked=final, now_s=time.monotonic())
                    self.counts.add(failures=1)
                    times = "1 try" if tries == 1 else f"{tries} tries"
                    what = f"{error.what} ({times} in {time.monotonic() - began_s:.1f} s)"
                    raise OriginError(error.url, what, passing=error.passing) from None
            else:
                self._note_end(worked=True, now_s=time.monotonic())
                return result
            self._closing.wait(pause_s * random.uniform(0.5, 1.0))  # noqa: S311 - no secret
            pause_s = min(2.0 * pause_s, _LONGEST_PAUSE_S)

    def _may_ask(self, path: str, now_s: float) -> bool:
        """Tell whether to be patient; raises OriginError where asking was in vain a moment ago."""
        with self._lock:
            failed_s = self._failed_s
            if failed_s is None:
                return True
            since_s = now_s - failed_s
            if since_s < self.options.cool_down_s:
                self.counts.add(failures=1)
                raise OriginError(
                    f"{self.url}/{path}",
                    f"not asked for: nothing came from there {since_s:.1f} s ago, "
                    f"asked again after {self.options.cool_down_s:g} s",
                )
            return False

    def _note_end(self, *, worked: bool, now_s: float) -> None:
        """Note whether anything came; one failure among successes is not the place's fault."""
        with self._lock:
            if worked:
                self._worked_s, self._failed_s = now_s, None
            elif now_s - self._worked_s > self.options.timeout_s / 2.0:
                self._failed_s = now_s

    @contextmanager
    def _named(self, path: str) -> Iterator[None]:
        """Turn obstore's errors into ours."""
        url = f"{self.url}/{path}"
        try:
            yield
        except FileNotFoundError:
            raise FileNotFoundError(2, "no such object", path) from None
        except OriginError:
            raise
        except (BaseError, ValueError, OSError) as error:
            status = _STATUS.search(str(error))
            refused = (
                status is not None
                and 400 <= int(status[1]) < 500
                and int(status[1]) not in _WORTH_ANOTHER_TRY
            )
            passing = not refused and not isinstance(error, _FINAL)
            raise OriginError(url, _said(error), passing=passing) from None


def _make_store(url: str, options: ObjectOptions) -> _Store:
    address = urlsplit(url)
    if not address.scheme or (address.scheme != "file" and not address.netloc):
        raise ValueError("expected an address like s3://BUCKET/PREFIX")
    client: ClientConfig = {
        "timeout": timedelta(seconds=options.timeout_s),
        "read_timeout": timedelta(seconds=options.stall_s),
        "connect_timeout": timedelta(seconds=min(_CONNECT_S, options.timeout_s)),
    }
    retry: RetryConfig = {
        "max_retries": options.part_retries,
        "retry_timeout": timedelta(seconds=options.timeout_s if options.part_retries else 0.0),
    }
    if address.scheme == "file":
        return LocalStore(prefix=address.path)
    if address.scheme in {"http", "https"}:
        client["allow_http"] = address.scheme == "http"
        return HTTPStore.from_url(url, client_options=client, retry_config=retry)
    if address.scheme not in {"s3", "s3a"}:
        return from_url(url, client_options=client, retry_config=retry)
    config: S3Config = {}
    endpoint = options.endpoint or _environment("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
    if endpoint is not None:
        service = urlsplit(endpoint)
        if service.scheme not in {"http", "https"} or not service.netloc:
            # obstore would panic at the first request.
            raise ValueError(f"the endpoint is {endpoint!r}, expected one like http://HOST:9000")
        config["endpoint"] = endpoint.rstrip("/")
        # Whoever names an http address wants it.
        client["allow_http"] = endpoint.startswith("http://")
    if options.region is not None:
        config["region"] = options.region
    elif _environment("AWS_REGION", "AWS_DEFAULT_REGION") is None:
        config["region"] = "us-east-1"
    return S3Store(
        address.netloc,
        prefix=address.path.strip("/") or None,
        config=config,
        client_options=client,
        retry_config=retry,
    )


def _environment(*names: str) -> str | None:
    return next((os.environ[name] for name in names if os.environ.get(name)), None)


def _said(error: BaseException) -> str:
    """Say what an error means; else its first line: the rest is obstore's innards."""
    line = str(error).partition("\n")[0].strip()
    if any(service in line for service in _ROLE_SERVICES):
        return (
            "no credentials, expected AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY in the "
            "environment, or a role of this machine"
        )
    unanswered = _NO_ANSWER.search(line)
    if unanswered is not None:
        return f"nothing answers at {unanswered[1]}, expected the storage's service"
    return line[:300] or type(error).__name__
