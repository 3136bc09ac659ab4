"""Kill -9 builds at random points: the published scene is always the old or the new one, whole.

Each round renews a scene in a process of its own and kills it at a random moment between its start
and its end; then the scene is opened and every hash, bound and payload checked. Every other round
starts with the meshes ready, so that most of its time is packing and publishing.

    python benchmarks/kill_build.py            20 rounds, about 4 minutes
    python benchmarks/kill_build.py --smoke    3 rounds
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from terraport_store.manifest import Manifest
from terraport_store.validate import validate_scene

RUN = """
import sys
from pathlib import Path
from terraport_pipeline.workflow.build import BuildOptions, build
from terraport_pipeline.stages import reconstruct, segment
print("ready", flush=True)
build(BuildOptions(
    Path(sys.argv[1]), Path(sys.argv[2]), name=sys.argv[3], resume=sys.argv[4] == "resume",
    reconstruct=reconstruct.Options(base_faces=2000),
    segment=segment.Options(min_faces=200, max_faces=1000),
))
"""


def write_survey(path: Path) -> None:
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-20, 20, (2, 6000))
    z = 3 * np.sin(x / 6) * np.cos(y / 7)
    rows = [f"{a:.3f} {b:.3f} {c:.3f}" for a, b, c in zip(x, y, z, strict=True)]
    path.write_text("\n".join(["x y z", *rows, ""]), encoding="ascii")


def start(survey: Path, scene: Path, name: str, *, resume: bool) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", RUN, survey, scene, name, "resume" if resume else "again"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    if process.stdout.readline() != "ready\n":
        raise SystemExit(f"the build did not start: {process.communicate()[1]}")
    return process


def finish(survey: Path, scene: Path, name: str, *, resume: bool) -> float:
    began = time.monotonic()
    process = start(survey, scene, name, resume=resume)
    began = time.monotonic()
    _, stderr = process.communicate()
    if process.returncode:
        raise SystemExit(f"a build that nobody killed failed: {stderr}")
    return time.monotonic() - began


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--smoke", action="store_true")
    arguments = parser.parse_args()
    rounds = 3 if arguments.smoke else arguments.rounds
    rng = np.random.default_rng(arguments.seed)
    folder = Path(tempfile.mkdtemp(prefix="kill-build-"))
    survey, scene = folder / "hill.xyz", folder / "hill"
    try:
        # How long a build takes is the range from which the moment of the kill is drawn.
        write_survey(survey)
        whole_s = finish(survey, scene, "name 0", resume=False)
        pack_s = finish(survey, scene, "name 1", resume=True)
        print(f"a whole build takes {whole_s:.2f} s, packing and publishing alone {pack_s:.2f} s")
        broken = 0
        outcomes = {"old": 0, "new": 0}
        for number in range(rounds):
            resume = number % 2 == 1
            if resume:  # the round before was killed somewhere: make its meshes ready again
                finish(survey, scene, f"before {number}", resume=True)
            # Kill a build at a random moment; every second one while it packs and publishes.
            old = Manifest.from_bytes((scene / "scene.json").read_bytes())
            name = f"round {number}"
            wait_s = float(rng.uniform(0, 1.05 * (pack_s if resume else whole_s)))
            process = start(survey, scene, name, resume=resume)
            time.sleep(wait_s)
            process.kill()
            process.wait()
            # The scene is whole: the old version or the new one, and valid.
            findings = validate_scene(scene)
            after = Manifest.from_bytes((scene / "scene.json").read_bytes())
            state = "new" if after.name == name else "old"
            outcomes[state] += 1
            whole = not findings and after.version == (
                old.version if state == "old" else after.version
            )
            broken += not whole
            print(
                f"round {number:2d}: killed after {wait_s:5.2f} s of "
                f"{'packing' if resume else 'all'}: {state} scene, "
                f"{'whole' if whole else f'BROKEN: {findings}'}"
            )
        # The next build that ends cleans up after all of them.
        finish(survey, scene, "after all", resume=True)
        left = sorted(p.name for p in scene.iterdir() if p.name.endswith(".tmp"))
        print(
            f"{rounds} kills: {outcomes['old']} old, {outcomes['new']} new, {broken} broken; "
            f"left behind after the next build: {left or 'nothing'}"
        )
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return 1 if broken or left else 0


if __name__ == "__main__":
    sys.exit(main())
