"""What a figure was made with: version, commit, libraries, machine."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path

__all__ = ["commit_of_this", "versions_of_this"]


def versions_of_this() -> dict[str, str]:
    """Name the version of the code and of what decides its figures, and the machine."""
    versions = {"commit": commit_of_this()}
    for name in ("terraport", "numpy", "scipy", "numba", "embreex"):
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "not installed"
    machine = {"python": platform.python_version(), "cores": str(os.cpu_count())}
    return versions | machine


def commit_of_this() -> str:
    """Name the commit of the checkout that this code lies in, with a + where it was changed."""

    def git(*words: str) -> str:
        asked = ["git", "-C", str(Path(__file__).parent), *words]
        done = subprocess.run(asked, capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""

    try:
        tracked = git("ls-files", "--error-unmatch", Path(__file__).name)
        commit = git("rev-parse", "--short=12", "HEAD") if tracked else ""
        changed = git("status", "--porcelain", "--untracked-files=no") if commit else ""
    except OSError:  # no git
        return "of an installed package"
    return f"{commit}{'+' if changed else ''}" if commit else "of an installed package"
