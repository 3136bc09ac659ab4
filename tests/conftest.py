"""Fixtures that every test folder may use."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from hypothesis import HealthCheck, settings

# Wall time is never asserted, neither of an example (deadline) nor of its making (too_slow): a busy
# machine is no fault of theirs.
settings.register_profile("terraport", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("terraport")

# A script that runs in the background ignores SIGINT, and all its children inherit that; several
# tests press Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Collecting makes millions of objects that all stay: looking through them for garbage, again and
# again, is a quarter of its time.
gc.disable()

STARTS_FIRST: Final = (
    "engines/test_landings.py",  # compiles the C++ core while another worker compiles kernels
    "end_to_end/test_bad_input.py",
    "browser/test_pictures.py",
    "end_to_end/test_labels.py",
    "end_to_end/test_whole_path.py",
    "browser/test_headset.py",
    "pipeline/workflow/test_build.py",
    "engines/test_unity_api.py",
    "browser/test_faults.py",
    "engines/test_engine_layers.py",
    "browser/test_landings.py",
    "engines/test_faults.py",
)
"""Files that take longest; between the browser's, which wait for each other, others."""

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_configure(config: pytest.Config) -> None:
    """Let pytest-xdist hand out files in the order below, not by how many tests they have."""
    config.option.loadscopereorder = False


def pytest_xdist_auto_num_workers() -> int:
    """Return more workers than cores: tests of services and browsers wait a third of their time."""
    cores = os.cpu_count() or 1
    return 2 * cores


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first: begun last, one of them keeps a single worker busy alone."""
    folder = Path(__file__).parent
    rank = {folder / name: number for number, name in enumerate(STARTS_FIRST)}
    items.sort(key=lambda item: rank.get(item.path, len(rank)))


def pytest_collection_finish() -> None:
    """Look for garbage again, but no more among what was collected."""
    gc.freeze()
    gc.enable()


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
