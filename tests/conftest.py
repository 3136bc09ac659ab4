"""Fixtures that every test folder may use."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from hypothesis import HealthCheck, settings
from xdist.remote import Producer
from xdist.scheduler import LoadFileScheduling

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

ONE_AFTER_ANOTHER: Final = "browser"
"""Folder whose files one worker runs: a browser draws with every core there is, so two of them gain
nothing, and a worker that waits for its turn does nothing else."""

STARTS_FIRST: Final = (
    ONE_AFTER_ANOTHER,
    "engines/test_unreal.py",  # compiles the C++ core while another worker compiles kernels
    "end_to_end/test_bad_input.py",
    "end_to_end/test_labels.py",
    "end_to_end/test_whole_path.py",
    "pipeline/workflow/test_build.py",
    "engines/test_unity_api.py",
    "engines/test_engine_layers.py",
    "engines/test_unity_visits.py",
)
"""Files and folders that take longest."""

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_configure(config: pytest.Config) -> None:
    """Let pytest-xdist hand out files in the order below, not by how many tests they have."""
    config.option.loadscopereorder = False


def pytest_xdist_auto_num_workers() -> int:
    """Return more workers than cores: tests of services and browsers wait a third of their time."""
    cores = os.cpu_count() or 1
    return 2 * cores


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadFileScheduling | None:
    """Hand out files with ``--dist loadfile``, but one folder as if it were one."""
    return FilesAndOneFolder(config, log) if config.getoption("dist") == "loadfile" else None


def pytest_xdist_setupnodes(config: pytest.Config) -> None:
    """Compile the kernels before the workers of a whole run begin.

    Else each worker, and each build that it starts, compiles the same ones at the same time. One
    process goes forwards, one backwards; where they are compiled already both end at once.
    """
    if config.args_source is not pytest.Config.ArgsSource.TESTPATHS:
        return
    program = "from terraport_pipeline.warm import read_kernels, warm; warm(read_kernels()[::{}])"
    ways = [subprocess.Popen([sys.executable, "-c", program.format(step)]) for step in (1, -1)]
    for way in ways:
        way.wait()


class FilesAndOneFolder(LoadFileScheduling):
    """A file's tests to one worker, and so all of the folder that runs one after another."""

    def _split_scope(self, nodeid: str) -> str:
        folder = f"tests/{ONE_AFTER_ANOTHER}/"
        return folder if nodeid.startswith(folder) else super()._split_scope(nodeid)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest first: begun last, one of them keeps a single worker busy alone."""
    folder = Path(__file__).parent
    rank = {folder / name: number for number, name in enumerate(STARTS_FIRST)}
    items.sort(
        key=lambda item: min(rank.get(at, len(rank)) for at in (item.path, *item.path.parents))
    )


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
