"""The Khronos glTF validator, in Node: the npm package ``gltf-validator``.

It is looked for in the folder named by ``TERRAPORT_GLTF_VALIDATOR``, then in the user's cache;
where it is in neither and npm is there, it is installed into the cache, once (1 MB, over the
network), and that is announced first. Call it only where the user asked for it. Without Node, npm
or a network nothing is raised: the answer says that it was not run, and why.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

__all__ = ["PACKAGE", "GltfCheck", "GltfMessage", "check_gltf"]

PACKAGE: Final = "gltf-validator@2.0.0-dev.3.10"
"""Pinned: another version may judge otherwise."""

INSTALL_TIMEOUT_S: Final = 120
RUN_TIMEOUT_S: Final = 300
MAX_MESSAGES: Final = 50
"""Kept in all; the counts go on."""

FOLDER_VARIABLE: Final = "TERRAPORT_GLTF_VALIDATOR"

_SCRIPT: Final = """
const fs = require('fs');
const validator = require('gltf-validator');
(async () => {
  for (const file of process.argv.slice(1)) {
    const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)),
      { uri: file, maxIssues: 20 });
    console.log(JSON.stringify({ file, issues: report.issues }));
  }
})().catch(error => { console.error(String(error)); process.exit(3); });
"""


@dataclass(frozen=True, slots=True)
class GltfMessage:
    """One message of the Khronos validator about one file."""

    name: str
    """Which payload, as the caller called it."""
    severity: int
    """0 error, 1 warning, 2 information, 3 hint."""
    code: str
    text: str


@dataclass(frozen=True, slots=True)
class GltfCheck:
    """Counts and messages of the Khronos validator, or why it did not run."""

    checked: int
    """Payloads looked at; 0 when it was not run."""
    errors: int = 0
    warnings: int = 0
    messages: tuple[GltfMessage, ...] = ()
    """Errors and warnings, the first 50."""
    not_run: str = ""
    """Why it was not run; empty when it was."""


def check_gltf(
    payloads: Mapping[str, bytes | memoryview],
    *,
    announce: Callable[[str], None] | None = None,
) -> GltfCheck:
    """Let the Khronos validator judge some GLB payloads.

    Parameters
    ----------
    payloads : mapping of str to bytes
        GLBs by the name to report them under.
    announce : callable, optional
        Gets one line of text before npm is asked for the package.

    Returns
    -------
    GltfCheck
        Never raises for want of Node, npm or a network: ``not_run`` says so.
    """
    node = shutil.which("node")
    if node is None:
        return GltfCheck(0, not_run="Node.js is not installed")
    folder, reason = _find_package(node, announce)
    if folder is None:
        return GltfCheck(0, not_run=reason)
    if not payloads:
        return GltfCheck(0)
    with tempfile.TemporaryDirectory(prefix="terraport-gltf-") as scratch:
        names = {}
        for number, (name, data) in enumerate(payloads.items()):
            path = Path(scratch) / f"{number}.glb"
            path.write_bytes(data)
            names[str(path)] = name
        try:
            run = subprocess.run(
                [node, "-e", _SCRIPT, *names],
                cwd=folder,
                capture_output=True,
                text=True,
                timeout=RUN_TIMEOUT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return GltfCheck(0, not_run=f"the validator took more than {RUN_TIMEOUT_S} s")
    if run.returncode != 0:
        return GltfCheck(0, not_run=f"the validator failed: {run.stderr.strip()[-300:]}")
    return _parse(run.stdout, names)


def _parse(output: str, names: Mapping[str, str]) -> GltfCheck:
    errors = warnings = checked = 0
    messages: list[GltfMessage] = []
    for line in output.splitlines():
        report = json.loads(line)
        issues = report["issues"]
        checked += 1
        errors += int(issues["numErrors"])
        warnings += int(issues["numWarnings"])
        messages += [
            GltfMessage(
                names[report["file"]],
                int(message["severity"]),
                str(message["code"]),
                f"{message['message']} {message.get('pointer', '')}".strip(),
            )
            for message in issues["messages"]
            if message["severity"] <= 1
        ]
    return GltfCheck(checked, errors, warnings, tuple(messages[:MAX_MESSAGES]))


def _find_package(node: str, announce: Callable[[str], None] | None) -> tuple[Path | None, str]:
    """Find a folder from which Node can load the package, or say why there is none."""
    # (1) The folder that the environment names; only that one then.
    named = os.environ.get(FOLDER_VARIABLE)
    if named:
        folder = Path(named)
        if _loads(node, folder):
            return folder, ""
        return None, f"{FOLDER_VARIABLE}={named} holds no gltf-validator"
    # (2) The cache, filled by an earlier run.
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = cache / "terraport" / PACKAGE.replace("@", "-")
    if _loads(node, folder):
        return folder, ""
    # (3) The registry, said before it is asked.
    npm = shutil.which("npm")
    if npm is None:
        return None, "the npm package gltf-validator is not installed, and npm is not there"
    if announce is not None:
        announce(f"fetching {PACKAGE} from the npm registry into {folder}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        options = ["--no-audit", "--no-fund", "--no-save", "--ignore-scripts", "--silent"]
        run = subprocess.run(
            [npm, "install", "--prefix", str(folder), *options, PACKAGE],
            capture_output=True,
            text=True,
            timeout=INSTALL_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return None, f"npm could not install gltf-validator: {error}"
    if run.returncode != 0 or not _loads(node, folder):
        return None, "npm could not install gltf-validator (no network?)"
    return folder, ""


def _loads(node: str, folder: Path) -> bool:
    if not folder.is_dir():
        return False
    run = subprocess.run(
        [node, "-e", "require('gltf-validator')"],
        cwd=folder,
        capture_output=True,
        timeout=RUN_TIMEOUT_S,
        check=False,
    )
    return run.returncode == 0
