"""The whole build on a Dask cluster against builds of this machine: the same bytes.

Starts a scheduler and two workers as the documentation says, on 127.0.0.1, and builds one survey
of a dozen tiles: in processes of this machine, in line, on the cluster, and on the cluster while
one of its workers is killed (SIGKILL) in the middle of a tile, then both, with what minds them.

    python benchmarks/cluster_build.py            about 4 minutes
    python benchmarks/cluster_build.py --smoke    in processes and on the cluster
"""

from __future__ import annotations

import argparse
import contextlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import psutil
from parts.hill_surveys import BUILD_OPTIONS, write_hill
from parts.killed_command import check_scene, finished_tiles, scene_bytes

START_S: Final = 60.0
GIVEN_UP_S: Final = 150.0
"""A build ends within this time also where no worker is left."""
BUILDS: Final = ("in line", "one thread", "cluster", "a worker lost", "all workers lost")

MAIN: Final = "import sys; from terraport.cli import main; sys.exit(main())"
INLINE: Final = """
import sys
from terraport_pipeline.engines.tile_pool import TilePool
from terraport_pipeline.workflow import reconstruct_step
reconstruct_step.TilePool = lambda _, cluster: TilePool(0, cluster)
from terraport.cli import main
sys.exit(main())
"""


@dataclass
class Cluster:
    """A scheduler and its workers, each with the process that starts it again (its nanny)."""

    address: str
    nannies: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def workers(self) -> list[psutil.Process]:
        """List the processes that carry out jobs."""
        return [
            child
            for nanny in self.nannies
            if nanny.poll() is None
            for child in psutil.Process(nanny.pid).children(recursive=True)
            if "spawn_main" in " ".join(child.cmdline()) and child.cpu_times().user > 0.5
        ]


@contextlib.contextmanager
def cluster(folder: Path, workers: int = 2) -> Iterator[Cluster]:
    """Start ``dask scheduler`` and workers; end them."""
    dask = str(Path(sys.executable).with_name("dask"))
    noted = folder / "scheduler.json"
    common = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    scheduler = subprocess.Popen(
        [dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
         "--scheduler-file", str(noted)],
        **common,
    )  # fmt: skip
    started = Cluster("")
    try:
        wait_for(noted.exists, "the scheduler")
        import distributed

        with distributed.Client(scheduler_file=str(noted), set_as_default=False) as client:
            started.address = client.scheduler.address
            for _ in range(workers):
                started.nannies.append(
                    subprocess.Popen(
                        [dask, "worker", started.address, "--nthreads", "1", "--no-dashboard",
                         "--host", "127.0.0.1"],
                        **common,
                    )
                )  # fmt: skip
            client.wait_for_workers(workers, timeout=START_S)
        yield started
    finally:
        for process in (*started.nannies, scheduler):
            process.terminate()
        for process in (*started.nannies, scheduler):
            process.wait()
        noted.unlink(missing_ok=True)


def wait_for(done: Callable[[], bool], what: str, most_s: float = START_S) -> None:
    """Wait until something is so."""
    end = time.monotonic() + most_s
    while not done():
        if time.monotonic() > end:
            raise SystemExit(f"{what}: waited {most_s:.0f} s")
        time.sleep(0.05)


@dataclass
class Place:
    """A survey, and the bytes that its builds should publish."""

    folder: Path
    expected: dict[str, str] | None = None
    wrong: list[str] = field(default_factory=list)

    def command(self, title: str, *options: str) -> list[str]:
        """Give the command of one build."""
        survey, scene = self.folder / "hill.xyz", self.folder / title / "hill"
        return ["build", str(survey), "-o", str(scene), *BUILD_OPTIONS, *options]

    def compare(self, title: str, said: str) -> None:
        """Compare a scene with the first one."""
        scene = self.folder / title / "hill"
        _, findings = check_scene(scene)
        files = scene_bytes(scene)
        self.expected = self.expected or files
        same = files == self.expected and not findings
        if not same:
            self.wrong.append(title)
        tiles = sum(
            name.startswith("solve-") for name in finished_tiles(scene.parent / ".hill.work")
        )
        verdict = f"{len(files)} files, the same bytes" if same else f"OTHER BYTES {findings}"
        print(f"{title}: {tiles} tiles, {said}; {verdict}", flush=True)

    def build(self, title: str, *options: str, main: str = MAIN) -> None:
        """Build, and compare."""
        began = time.monotonic()
        command = [sys.executable, "-c", main, *self.command(title, *options)]
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        if ended.returncode:
            raise SystemExit(f"{title}: {ended.stderr}")
        self.compare(title, f"{time.monotonic() - began:.1f} s")

    def build_killing(self, title: str, running: Cluster, *, minders: bool) -> None:
        """Build on a cluster; kill a worker while the third tile is solved, or both and minders."""
        began = time.monotonic()
        command = self.command(title, "--cluster", running.address)
        process = subprocess.Popen(
            [sys.executable, "-c", MAIN, *command], stderr=subprocess.PIPE, text=True
        )
        work = self.folder / title / ".hill.work"
        wait_for(lambda: len(list(work.glob("solve-*/stage.json"))) >= 2, "two tiles")
        victims = running.workers() if minders else running.workers()[:1]
        for nanny in running.nannies if minders else []:
            nanny.kill()
        for victim in victims:
            with contextlib.suppress(psutil.NoSuchProcess):
                victim.send_signal(signal.SIGKILL)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(GIVEN_UP_S)
        if process.poll() is None:
            self.wrong.append(f"{title}: waits for ever")
            process.send_signal(signal.SIGINT)
        _, stderr = process.communicate()
        said = f"{len(victims)} of its workers killed, ended with {process.returncode}"
        said += f" after {time.monotonic() - began:.1f} s{': ' + stderr.strip() if stderr else ''}"
        if process.returncode:
            version, _ = check_scene(self.folder / title / "hill")
            if version is not None:
                self.wrong.append(f"{title}: published")
            print(f"{title}: {said}", flush=True)
            self.build(title)  # goes on with processes of this machine
        else:
            self.compare(title, said)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--builds", choices=BUILDS, nargs="+", default=BUILDS)
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    builds = ("cluster",) if arguments.smoke else arguments.builds
    place = Place(Path(tempfile.mkdtemp(prefix="cluster-build-")))
    try:
        write_hill(place.folder / "hill.xyz")
        place.build("processes")
        if "in line" in builds:
            place.build("in line", main=INLINE)
        if "one thread" in builds:
            place.build("one thread", "--threads", "1")
        with cluster(place.folder) as running:
            if "cluster" in builds:
                place.build("cluster", "--cluster", running.address)
            for title in BUILDS[3:]:
                if title in builds:
                    place.build_killing(title, running, minders=title == BUILDS[-1])
        print(f"not as they should be: {place.wrong or 'none'}")
    finally:
        shutil.rmtree(place.folder, ignore_errors=True)
    return 1 if place.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
