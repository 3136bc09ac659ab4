from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from terraport_pipeline.engines import poisson
from terraport_pipeline.errors import EngineError, ResourceError


def sphere(count: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return (5.0 * normals).astype(np.float32), normals.astype(np.float32)


def test_a_sphere_comes_back_oriented_and_close(tmp_path: Path) -> None:
    points, normals = sphere()
    ticks: list[float] = []
    started = time.monotonic()
    vertices, faces = poisson.reconstruct(points, normals, 6, tmp_path, tick=ticks.append)
    assert 0 < sum(ticks) <= time.monotonic() - started
    assert not list(tmp_path.iterdir())
    assert np.abs(np.linalg.norm(vertices, axis=1) - 5.0).max() < 0.1
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(axis=1) > 0).mean() > 0.999
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)


def test_the_same_samples_give_the_same_bytes(tmp_path: Path) -> None:
    first, second = (poisson.reconstruct(*sphere(), 5, tmp_path) for _ in range(2))
    assert first[0].tobytes() == second[0].tobytes()
    assert first[1].tobytes() == second[1].tobytes()


def test_more_memory_than_allowed_stops_the_child(tmp_path: Path) -> None:
    before = set(psutil.Process().children())  # other tests may have left a fork server
    with pytest.raises(ResourceError, match="--detail-depth"):
        poisson.reconstruct(*sphere(), 9, tmp_path, max_memory_bytes=40 * 2**20)
    assert not list(tmp_path.iterdir())
    assert not set(psutil.Process().children()) - before


def test_a_failing_child_is_told_with_what_it_printed(tmp_path: Path) -> None:
    with pytest.raises(
        EngineError, match=r"(?s)depth -1 ended with exit code .*, 2 times; it .*dep"
    ):
        poisson.reconstruct(*sphere(100), -1, tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_interrupt_ends_the_children(tmp_path: Path) -> None:
    before = set(psutil.Process().children())

    def stop(_: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        poisson.reconstruct(*sphere(), 9, tmp_path, tick=stop)
    assert not set(psutil.Process().children()) - before
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="the child asks Linux to die with its parent")
def test_a_killed_parent_takes_its_children_along(tmp_path: Path) -> None:
    script = (
        "import numpy as np; from pathlib import Path\n"
        "from terraport_pipeline.engines import poisson\n"
        "n = np.random.default_rng(1).normal(size=(60_000, 3)).astype(np.float32)\n"
        "n /= np.linalg.norm(n, axis=1)[:, None]\n"
        f"poisson.reconstruct(5 * n, n, 10, Path({str(tmp_path)!r}))\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", script], env=os.environ)
    children: list[psutil.Process] = []
    deadline = time.monotonic() + 30
    while not children and time.monotonic() < deadline and parent.poll() is None:
        children = psutil.Process(parent.pid).children()
        time.sleep(0.05)
    assert children, "the reconstruction never started its child"
    parent.kill()
    parent.wait()
    gone, alive = psutil.wait_procs(children, timeout=10)
    assert gone
    assert not alive


@pytest.mark.parametrize(
    ("requested_depth", "extent_m", "spacing_m", "expected"),
    [(13, 400.0, 0.4, 10), (9, 400.0, 0.4, 9), (13, 1.0, 10.0, 1), (13, 400.0, 0.0535, 13)],
)
def test_depth_follows_the_density(
    requested_depth: int, extent_m: float, spacing_m: float, expected: int
) -> None:
    assert poisson.depth_for(requested_depth, extent_m, spacing_m) == expected


def test_forecast_grows_with_depth_until_the_samples_run_out() -> None:
    costs = [poisson.forecast(10**6, depth, 400.0, 220_000.0) for depth in range(7, 14)]
    memory = [cost.memory_bytes for cost in costs]
    assert memory == sorted(memory)
    assert memory[-1] == memory[-2]
    # Measured with PoissonRecon: 1 M points of rough ground at depth 9 took 0.5 GB and 0.9 M faces.
    assert 0.4e9 < memory[2] < 1.0e9
    assert 0.6e6 < costs[2].faces < 1.4e6
