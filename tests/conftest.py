"""Fixtures that every test folder may use."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# Wall time is never asserted: a busy machine is no fault of an example's.
settings.register_profile("terraport", deadline=None)
settings.load_profile("terraport")

# A script that runs in the background ignores SIGINT, and all its children inherit that; several
# tests press Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real surveys beside the checkout; skips where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"no real surveys at {SHARED_DATA}")
    return SHARED_DATA


@pytest.fixture(scope="session")
def moto() -> Iterator[str]:
    """Address of moto's S3, in this process."""
    from s3_servers import moto_server

    with moto_server() as url:
        yield url


@pytest.fixture(scope="session")
def weed() -> Iterator[str]:
    """Address of a SeaweedFS, a process of its own; skips where it cannot run."""
    from s3_servers import weed_server

    with weed_server() as url:
        yield url
