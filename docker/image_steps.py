"""Runs the Dockerfile's own steps in a clean root, and what comes out of them. No engine needed.

::

    python docker/image_steps.py                   # the server's image: two minutes
    python docker/image_steps.py server pipeline   # the pipeline's too, with a small build

A Debian root of the base image's release with its Python takes the base's place (mmdebstrap; no
image registry is asked). Each stage is an overlay on it, so that its size is that of the layers.
RUN, COPY, ENV, WORKDIR and USER do what the Dockerfile says. Then the image's command runs in the
result as its user, with a read-only root and no network but its own: health check, and a landing by
the image's own ``terraport land``. Needs root on Linux.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from commands import say
from dockerfile import Stage, read_stages

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
PACKAGES = "python3,python3-venv,python3-pip,ca-certificates"
IGNORED = shutil.ignore_patterns("__pycache__", ".env", "node_modules")
BUILT_PAGE = Path("server/terraport_server/page")
"""As Dockerfile.dockerignore has it: the image builds its own."""


def run(*command: str) -> str:
    """Run a command that must succeed."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"failed: {' '.join(command)}\n{done.stdout[-3000:]}{done.stderr[-3000:]}")
    return done.stdout


class Images:
    """Stages of the Dockerfile, each built as a root folder: an overlay on the stage below."""

    def __init__(self, work: Path) -> None:
        self._work = work
        self.stages, _ = read_stages(HERE / "Dockerfile")
        self._roots: dict[str, Path] = {}
        self._mounted: list[Path] = []

    def base(self, release: str, kept: Path | None) -> Path:
        """Make the clean root that stands for the base image, or take one that was kept."""
        root = self._roots["base"] = kept or self._work / "base"
        if root.exists():
            return root
        run(
            "mmdebstrap",
            "--quiet",
            "--variant=minbase",
            f"--include={PACKAGES}",
            release,
            str(root),
        )
        # The official image has `python` and `pip`, and lets pip install outside of an environment.
        for name in ("python", "pip"):
            (root / "usr/local/bin" / name).symlink_to(f"/usr/bin/{name}3")
        for marker in root.glob("usr/lib/python3*/EXTERNALLY-MANAGED"):
            marker.unlink()
        # Where this machine finds packages, and whom it trusts.
        for name in (
            "etc/pip.conf",
            "etc/resolv.conf",
            "etc/ssl/certs/ca-certificates.crt",
            "root/.npmrc",
        ):
            if Path("/", name).is_file():
                shutil.copyfile(Path("/", name), root / name)
        return root

    def build(self, name: str) -> Path:
        """Carry out one stage and those that it copies from; return its root."""
        if name in self._roots:
            return self._roots[name]
        stage = self.stages[name]
        for word, text in stage.instructions:
            if word == "COPY" and text.startswith("--from="):
                self.build(text.split()[0].removeprefix("--from="))
        root = self._overlay(name)
        folder, environment = "/", {"PATH": "/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin"}
        for word, text in stage.instructions:
            if word == "WORKDIR":
                folder = text
                (root / folder.strip("/")).mkdir(parents=True, exist_ok=True)
            elif word == "ENV":
                instruction = Stage("", "", [(word, text)])
                environment |= instruction.environment(environment)
            elif word == "COPY":
                self._copy(root, folder, text)
            elif word == "RUN":
                self._chroot(root, folder, environment, ["sh", "-c", text])
        say(f"{name}: {_megabytes(self._work / name / 'upper'):.0f} MB on its base")
        return root

    def close(self) -> None:
        """Unmount the overlays, the last one first."""
        for path in reversed(self._mounted):
            subprocess.run(["umount", "--lazy", str(path)], check=False)

    def _overlay(self, name: str) -> Path:
        folder = self._work / name
        for layer in ("upper", "work", "root"):
            (folder / layer).mkdir(parents=True)
        layers = f"lowerdir={self._roots['base']},upperdir={folder}/upper,workdir={folder}/work"
        run("mount", "-t", "overlay", "overlay", "-o", layers, str(folder / "root"))
        self._mounted.append(folder / "root")
        self._roots[name] = folder / "root"
        return folder / "root"

    def _copy(self, root: Path, folder: str, text: str) -> None:
        words = text.split()
        source_root = ROOT
        if words[0].startswith("--from="):
            source_root = self._roots[words.pop(0).removeprefix("--from=")]
        *sources, target = words
        into = Path(folder) / target
        for source in sources:
            source_path = source_root / source.strip("/")
            destination = root / str(into).strip("/")
            if source_path.is_dir():
                shutil.copytree(
                    source_path, destination, dirs_exist_ok=True, symlinks=True, ignore=_ignored
                )
                continue
            if target.endswith("/") or target == ".":
                destination = destination / source_path.name
            destination.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source_path, destination)

    def _chroot(
        self, root: Path, folder: str, environment: dict[str, str], command: list[str]
    ) -> None:
        prefixes = ("PIP_", "npm_config_", "NODE_EXTRA_CA_CERTS")
        inherited = {name: os.environ[name] for name in os.environ if name.startswith(prefixes)}
        variables = [f"{name}={value}" for name, value in (environment | inherited).items()]
        words = ["env", "-i", *variables, "sh", "-c", f'cd {folder} && exec "$@"', "_", *command]
        mounts = f"mount -t proc proc {root}/proc; mount --bind /dev {root}/dev"
        for path in os.environ.get("PIP_FIND_LINKS", "").split():
            if Path(path).is_dir():
                (root / path.strip("/")).mkdir(parents=True, exist_ok=True)
                mounts += f"; mount --bind {path} {root}{path}"
        script = f'{mounts}; exec chroot {root} "$@"'
        run("unshare", "--mount", "--propagation", "private", "sh", "-c", script, "_", *words)


def _ignored(folder: str, names: list[str]) -> set[str]:
    left_out = IGNORED(folder, names)
    return left_out | {name for name in names if Path(folder, name) == ROOT / BUILT_PAGE}


def inside(root: Path, stage: Stage, script: str, mounts: list[tuple[Path, str]]) -> str:
    """Run a script in an image: its variables and user, a read-only root, a network of its own."""
    environment = {"PATH": "/usr/local/bin:/usr/bin:/bin", "HOME": "/"}
    environment |= stage.environment(environment)
    variables = " ".join(f"'{name}={value}'" for name, value in environment.items())
    user = stage.last("USER") or "0"
    lines = ["set -e", "ip link set lo up", f"mount -t proc proc {root}/proc"]
    lines.append(f"mount --bind /dev {root}/dev; mount -t tmpfs tmpfs {root}/tmp")
    for source, target in mounts:
        lines.append(f"mkdir -p {root}{target}; mount --bind {source} {root}{target}")
    lines.append(f"mount -o remount,ro,bind {root} 2>/dev/null || mount -o remount,ro {root}")
    rights = f"--reuid {user} --regid {user} --clear-groups --no-new-privs --bounding-set=-all"
    lines.append(f"exec chroot {root} setpriv {rights} env -i {variables} sh -c '{script}'")
    spaces = ["unshare", "--mount", "--net", "--propagation", "private"]
    return run(*spaces, "sh", "-c", "\n".join(lines))


def check_server(images: Images, scenes: Path) -> None:
    """Build the server's image; serve and land in it."""
    root = images.build("server")
    stage = images.stages["server"]
    command = " ".join([*stage.words("ENTRYPOINT"), *stage.words("CMD")])
    health = stage.healthcheck()
    assert health[:2] == ["python", "-c"]
    (root / "health.py").write_text(health[2])
    (root / "page.py").write_text(
        "import urllib.request as r\n"
        "assert b'./assets/' in r.urlopen('http://127.0.0.1:8080/').read(), 'no viewer'\n"
    )
    script = f"""
cd /tmp; touch /opt/x 2>/dev/null && exit 9
TERRAPORT_TOKEN=sixteen-characters {command} >log 2>&1 &
for i in $(seq 100); do python /health.py 2>/dev/null && break; sleep 0.2; done
python /health.py || {{ cat log >&2; exit 8; }}
python /page.py || exit 4
terraport land http://127.0.0.1:8080/scenes/big 30 1 30 --radius 100 --token sixteen-characters \\
  || {{ cat log >&2; exit 5; }}
kill $!; wait $! || true
if python /health.py 2>/dev/null; then exit 7; fi
test -z "$(find /opt/terraport -name "pip*" -maxdepth 5)" || exit 6
"""
    output = inside(root, stage, script, [(scenes, "/scenes")])
    assert "36" in output, output
    say(
        "ok: server: its user, a read-only root: healthy, shows the viewer, lands 36 segments, ends"
    )


def check_pipeline(images: Images, out: Path) -> None:
    """Build the pipeline's image; synthesise and build a small scene in it."""
    root = images.build("pipeline")
    stage = images.stages["pipeline"]
    os.chown(out, 10001, 10001)
    script = """
set -e; cd /tmp; terraport synth -o q.laz --points 60k >/dev/null
terraport build q.laz -o /scenes/quarry >/dev/null
terraport validate /scenes/quarry
terraport export /scenes/quarry -o /tmp/quarry.tif >/dev/null
python -c 'import sklearn'
python -c 'from terraport_pipeline.engines.ktx2 import require_encoder as check; check()'
"""
    inside(root, stage, script, [(out, "/scenes")])
    assert (out / "quarry/scene.json").is_file()
    say("ok: pipeline: builds a scene as its user on a read-only root")


def _megabytes(folder: Path) -> float:
    return int(run("du", "-s", "--block-size=1", str(folder)).split()[0]) / 1e6


def main() -> int:
    """Build and try the images that are asked for; skipped where that cannot be done."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("images", nargs="*", default=["server"], help="server, pipeline")
    parser.add_argument("--base", type=Path, help="keep the clean root there, and use it again")
    options = parser.parse_args()
    if sys.platform != "linux" or os.geteuid() != 0 or shutil.which("mmdebstrap") is None:
        say("skipped: needs root on Linux and mmdebstrap (apt-get install mmdebstrap)")
        return 0
    sys.path.insert(0, str(ROOT / "tests"))
    from server.grid_scene import write_grid_scene

    work = Path(tempfile.mkdtemp(prefix="terraport-image-"))
    work.chmod(0o755)
    images = Images(work)
    try:
        write_grid_scene(work / "scenes" / "big", cells=80, name="big")
        release = images.stages["server"].base.rsplit("-", 1)[1]
        base = images.base(release, options.base)
        say(f"a clean root of {release}: {_megabytes(base):.0f} MB")
        if "server" in options.images:
            check_server(images, work / "scenes")
        if "pipeline" in options.images:
            (work / "built").mkdir()
            check_pipeline(images, work / "built")
    finally:
        images.close()
        shutil.rmtree(work, ignore_errors=True)
    say("done")
    return 0


if __name__ == "__main__":
    sys.exit(main())
