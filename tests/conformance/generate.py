"""Write the conformance corpus of the wire: ``python tests/conformance/generate.py [--check]``.

Cases are made in ``wire_good.py`` and ``wire_bad.py``; the files are the same on every run.  Files
that no case makes any more are removed.  Exit code 1 with ``--check`` if anything differs.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

if __name__ == "__main__":  # run as a script: the package "conformance" lies in tests/
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from conformance.cases import Case
from conformance.wire_bad import bad_cases
from conformance.wire_good import good_cases

CORPUS = Path(__file__).resolve().parent / "wire"


def corpus_files() -> dict[str, bytes]:
    """Return path below the corpus -> bytes of every file."""
    files: dict[str, bytes] = {}
    for folder, cases in (("good", good_cases()), ("bad", bad_cases())):
        for case in cases:
            for suffix, data in ((".bin", case.data), (".json", _facts(case))):
                path = f"{folder}/{case.name}{suffix}"
                if path in files:
                    raise ValueError(f"got two cases named {path}, expected one")
                files[path] = data
    return files


def differences(files: dict[str, bytes]) -> list[str]:
    """Return the paths that are missing, different or left over on disk."""
    on_disk = {path.relative_to(CORPUS).as_posix() for path in CORPUS.rglob("*") if path.is_file()}
    changed = [
        name
        for name, data in files.items()
        if name not in on_disk or (CORPUS / name).read_bytes() != data
    ]
    return sorted(changed + list(on_disk - files.keys()))


def main() -> int:
    """Write or check; return the exit code."""
    files = corpus_files()
    changed = differences(files)
    if "--check" in sys.argv[1:]:
        for name in changed:
            sys.stderr.write(f"error: {name} is not what generate.py writes\n")
        return 1 if changed else 0
    for name in changed:
        path = CORPUS / name
        if name in files:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(files[name])
        else:
            path.unlink()
    sys.stdout.write(f"{len(files) // 2} cases, {len(changed)} files written or removed\n")
    return 0


def _facts(case: Case) -> bytes:
    return (json.dumps(case.facts, indent=1, ensure_ascii=False) + "\n").encode("utf-8")


if __name__ == "__main__":
    sys.exit(main())
