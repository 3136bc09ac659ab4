"""Known vulnerabilities and licences of what terraport pulls in.

``python .ci/audit.py [--require]``. Looks at the packages that ``terraport[all,cluster,eddsa]``
brings into this environment, directly or not, and at the development tools beside them; and at the
npm packages that the viewer's lock names, by the licences and versions in it.

Vulnerabilities come from PyPI's advisory database, by pip-audit. A registry mirror without it makes
pip-audit skip every package and still say "no known vulnerabilities": this counts what was really
looked up, says so in its last line, and with ``--require`` fails where it was not all.

Exit code 1: a vulnerability, a licence that is not on the list, or ``--require`` unmet.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

ROOT = "terraport"
WEB = Path(__file__).resolve().parents[1] / "client_sdk" / "web"
EXTRAS = {"all", "server", "pipeline", "export", "cluster", "eddsa", "s3", "dev"}
TIMEOUT_S = 240

ALLOWED = {
    "0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0",
    "CNRI-Python", "ISC", "MIT", "MIT-0", "MIT-CMU", "MPL-2.0", "PSF-2.0", "Python-2.0",
    "Unlicense", "Zlib", "LLVM-exception",
}  # fmt: skip
"""SPDX ids; docs/licences.md says what each is for. Weak copyleft by file (MPL) is as far as it
goes: nothing here is linked into what a user ships."""

SPOKEN = {
    "apache 2.0": "Apache-2.0", "apache license 2.0": "Apache-2.0", "apache-2.0": "Apache-2.0",
    "apache license, version 2.0": "Apache-2.0", "apache software license": "Apache-2.0",
    "apache license": "Apache-2.0", "apache": "Apache-2.0",
    "apache software license 2.0": "Apache-2.0", "apache 2": "Apache-2.0",
    "bsd": "BSD-3-Clause", "bsd license": "BSD-3-Clause", "new bsd": "BSD-3-Clause",
    "bsd 3-clause": "BSD-3-Clause", "bsd 3-clause license": "BSD-3-Clause",
    "bsd-3": "BSD-3-Clause", "3-clause bsd": "BSD-3-Clause", "bsd 2-clause": "BSD-2-Clause",
    "mit license": "MIT", "the mit license": "MIT", "expat": "MIT",
    "isc license (iscl)": "ISC", "isc license": "ISC",
    "mozilla public license 2.0 (mpl 2.0)": "MPL-2.0", "mpl 2.0": "MPL-2.0",
    "python software foundation license": "PSF-2.0", "psf": "PSF-2.0",
    "the unlicense (unlicense)": "Unlicense", "historical permission notice and disclaimer (hpnd)":
    "MIT-CMU",
}  # fmt: skip
"""What packages write where an SPDX id should be."""

LOOKED_UP = {
    "embreex": "BSD-2-Clause",
    "pypdfium2": "BSD-3-Clause AND Apache-2.0",
    "terraport": "Apache-2.0",
    "python-neo-lzf": "BSD-3-Clause",
}
"""Packages that state no licence in their metadata, or not in words that can be looked up, and what
their source says (pypdfium2: its own and PDFium's)."""


def main() -> int:
    """Run both checks; return the exit code."""
    parser = argparse.ArgumentParser(description="Audit what terraport pulls in.")
    parser.add_argument(
        "--require", action="store_true", help="fail where a package could not be looked up"
    )
    require = parser.parse_args().require
    packages = closure()
    bad = licences(packages)
    advisories, looked_up = vulnerabilities(packages)
    web = locked(json.loads((WEB / "package-lock.json").read_text()))
    bad_web = web_licences(web)
    known_web, asked_web = web_vulnerabilities()
    for line in [*bad, *advisories, *bad_web, *known_web]:
        print(line)
    missed = len(packages) - 1 - looked_up  # terraport itself is on no registry
    print(
        f"audit: {len(packages)} packages, {len(bad)} licences to look at, "
        f"{len(advisories)} known vulnerabilities among the {looked_up} that could be looked up"
    )
    if missed > 0:
        print(
            f"audit: NOT AUDITED for vulnerabilities: {missed} packages, because the registry "
            "here has no advisories for them (a mirror?); run it where https://pypi.org answers"
        )
    print(
        f"audit: {len(web)} npm packages, {len(bad_web)} licences to look at, "
        + (
            f"{len(known_web)} known vulnerabilities"
            if asked_web
            else "NOT AUDITED for vulnerabilities: npm's registry here has no advisories"
        )
    )
    missed += not asked_web
    return int(bool(bad or advisories or bad_web or known_web or (require and missed > 0)))


def closure() -> dict[str, Distribution]:
    """Return every installed package that ours needs, by normalised name."""
    distributions: dict[str, Distribution] = {}
    waiting = [ROOT]
    while waiting:
        name = waiting.pop()
        if name in distributions:
            continue
        try:
            distributions[name] = distribution(name)
        except PackageNotFoundError:  # an extra that is not installed, or another platform's
            continue
        waiting += needed(distributions[name], EXTRAS if name == ROOT else set())
    return distributions


def needed(package: Distribution, extras: set[str]) -> Iterator[str]:
    """Return the names that a package requires; other markers are answered by what is there."""
    ours = package.metadata["Name"] == ROOT
    for requirement in package.requires or ():
        required_extras = set(re.findall(r"extra\s*==\s*['\"]([^'\"]+)", requirement))
        # Extras of dependencies (uvicorn[standard]) are taken where they are installed.
        if ours and required_extras and not required_extras & extras:
            continue
        match = re.match(r"[A-Za-z0-9._-]+", requirement)
        if match:
            yield normalised(match[0])


def normalised(name: str) -> str:
    """Return a package's name as registries compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def licences(packages: dict[str, Distribution]) -> list[str]:
    """Return a line for each package whose licence is not on the list."""
    lines = []
    for name, package in sorted(packages.items()):
        stated = licence_of(name, package)
        if not is_allowed(stated):
            lines.append(f"licence: {name} {package.version} states {stated[:80]!r}")
    return lines


def is_allowed(stated: str) -> bool:
    """Whether a licence, or one of a choice, is on the list: "A OR B" is ours to choose."""
    choices = re.split(r"\s+OR\s+", stated)
    return any(_all_allowed(choice) for choice in choices)


def _all_allowed(stated: str) -> bool:
    terms = [term.strip() for term in re.split(r"\s+(?:AND|WITH)\s+|[;,/]", stated)]
    named = [SPOKEN.get(term.lower(), term.strip("() ")) for term in terms if term]
    return bool(named) and all(name in ALLOWED for name in named)


def licence_of(name: str, package: Distribution) -> str:
    """Return what a package states: an SPDX expression, else its classifiers, else its words."""
    if name in LOOKED_UP:
        return LOOKED_UP[name]
    metadata = package.metadata
    expression = metadata.get("License-Expression")
    if expression:
        return str(expression)
    classifiers = [
        line.rpartition("::")[2].strip()
        for line in metadata.get_all("Classifier") or ()
        if line.startswith("License ::") and not line.endswith(("OSI Approved", "DFSG approved"))
    ]
    if classifiers:
        return " AND ".join(classifiers)
    words = (metadata.get("License") or "").strip()
    return words.splitlines()[0] if words else ""


def vulnerabilities(packages: dict[str, Distribution]) -> tuple[list[str], int]:
    """Return a line for each known vulnerability, and how many packages were looked up."""
    pip_audit = subprocess.run(
        [
            sys.executable, "-m", "pip_audit", "--format", "json", "--progress-spinner", "off",
            "--skip-editable", "--timeout", "10",
        ],
        capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    try:
        entries = json.loads(pip_audit.stdout)["dependencies"]
    except (ValueError, KeyError):
        reason = (pip_audit.stderr.strip().splitlines() or ["it said nothing"])[-1]
        print(f"audit: pip-audit could not look anything up: {reason[:200]}")
        return [], 0
    lines, looked_up = [], 0
    for entry in entries:
        name = normalised(entry["name"])
        if name not in packages or "vulns" not in entry:
            continue
        looked_up += 1
        for advisory in entry["vulns"]:
            fixed = ", ".join(advisory.get("fix_versions") or ()) or "no version yet"
            lines.append(
                f"vulnerability: {name} {entry['version']} {advisory['id']}, fixed in {fixed}"
            )
    return lines, looked_up


def locked(lock: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the packages of an npm lock by name, those of other platforms too."""
    return {
        path.rpartition("node_modules/")[2]: facts
        for path, facts in lock["packages"].items()
        if path
    }


def web_licences(packages: dict[str, dict[str, Any]]) -> list[str]:
    """Return a line for each npm package whose licence is not on the list."""
    lines = []
    for name, facts in sorted(packages.items()):
        stated = str(facts.get("license", ""))
        if not is_allowed(stated):
            lines.append(f"licence: npm {name} {facts.get('version')} states {stated[:80]!r}")
    return lines


def web_vulnerabilities() -> tuple[list[str], bool]:
    """Return a line for each known vulnerability of npm packages, and whether that was told."""
    try:
        report = subprocess.run(
            ["npm", "audit", "--json", "--package-lock-only"],
            cwd=WEB, capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
        ).stdout  # fmt: skip
        entries = json.loads(report)["vulnerabilities"]
    except (OSError, subprocess.TimeoutExpired, ValueError, KeyError):
        return [], False
    lines = [
        f"vulnerability: npm {name} {entry['range']} ({entry['severity']})"
        for name, entry in sorted(entries.items())
    ]
    return lines, True


if __name__ == "__main__":
    sys.exit(main())
