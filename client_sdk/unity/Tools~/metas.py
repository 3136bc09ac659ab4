"""Write the .meta file beside every file and folder that Unity imports from this package.

Samples lie hidden in the package, and are copied into a project with their .meta files: a scene or
a prefab names scripts by their GUIDs.

Unity refuses assets of a package (which it may not write to) without them. A GUID is the MD5 of the
package's name and the path, so that it is the same on every machine and changes only when a file
moves.

    python client_sdk/unity/Tools~/metas.py            write what is missing or different,
                                                       delete what is left over
    python client_sdk/unity/Tools~/metas.py --check    write nothing, say what would change,
                                                       and exit with 1 where something would
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from pathlib import Path

PACKAGE = "com.terraport.client"
ROOT = Path(__file__).resolve().parent.parent

_END = """  userData:
  assetBundleName:
  assetBundleVariant:
"""
_DEFAULT = "DefaultImporter:\n  externalObjects: {}\n" + _END
_FOLDER = "folderAsset: yes\n" + _DEFAULT
_TEXT = "TextScriptImporter:\n  externalObjects: {}\n" + _END
_SCRIPT = (
    "MonoImporter:\n  externalObjects: {}\n  serializedVersion: 2\n  defaultReferences: []\n"
    "  executionOrder: 0\n  icon: {instanceID: 0}\n" + _END
)
_ASMDEF = "AssemblyDefinitionImporter:\n  externalObjects: {}\n" + _END
_SHADER = (
    "ShaderImporter:\n  externalObjects: {}\n  defaultTextures: []\n  nonModifiableTextures: []\n"
    "  preprocessorOverride: 0\n" + _END
)
_INCLUDE = "ShaderIncludeImporter:\n  externalObjects: {}\n" + _END
_MANIFEST = "PackageManifestImporter:\n  externalObjects: {}\n" + _END
# A browser's plug-in must not be linked into anything else.
_BROWSER = (
    """PluginImporter:
  externalObjects: {}
  serializedVersion: 2
  iconMap: {}
  executionOrder: {}
  defineConstraints: []
  isPreloaded: 0
  isOverridable: 0
  isExplicitlyReferenced: 0
  validateReferences: 1
  platformData:
  - first:
      Any:
    second:
      enabled: 0
      settings: {}
  - first:
      Editor: Editor
    second:
      enabled: 0
      settings:
        DefaultValueInitialized: true
  - first:
      WebGL: WebGL
    second:
      enabled: 1
      settings: {}
"""
    + _END
)

_PREFAB = "PrefabImporter:\n  externalObjects: {}\n" + _END

_BY_SUFFIX = {
    ".cs": _SCRIPT,
    ".asmdef": _ASMDEF,
    ".prefab": _PREFAB,
    ".shader": _SHADER,
    ".hlsl": _INCLUDE,
    ".jslib": _BROWSER,
    ".md": _TEXT,
    ".json": _TEXT,
    ".txt": _TEXT,
}


def is_imported(path: Path) -> bool:
    """Whether Unity looks at it: no .meta, nothing below a name like `.x` or `x~` but samples."""
    parts = path.relative_to(ROOT).parts
    if parts[0] == "Samples~":
        parts = parts[2:]  # each sample's folder gets its .meta where it is copied to
        if not parts:
            return False
    return path.suffix != ".meta" and not any(
        part.startswith(".") or part.endswith("~") for part in parts
    )


def meta_of(path: Path) -> str:
    """Text of the .meta file of a file or folder."""
    relative = path.relative_to(ROOT).as_posix()
    guid = hashlib.md5(f"{PACKAGE}/{relative}".encode(), usedforsecurity=False).hexdigest()
    if path.is_dir():
        body = _FOLDER
    elif relative == "package.json":
        body = _MANIFEST
    else:
        body = _BY_SUFFIX.get(path.suffix, _DEFAULT)
    return f"fileFormatVersion: 2\nguid: {guid}\n{body}"


def wanted() -> dict[Path, str]:
    """Text by path of every .meta file that there has to be."""
    assets = [path for path in sorted(ROOT.rglob("*")) if is_imported(path)]
    # An empty folder is not in git, and must not leave a .meta there.
    kept = [
        path
        for path in assets
        if path.is_file() or any(p.is_file() and is_imported(p) for p in path.rglob("*"))
    ]
    return {path.with_name(path.name + ".meta"): meta_of(path) for path in kept}


def main() -> int:
    """Bring the files up to date, or say what is not."""
    parser = argparse.ArgumentParser(description="Write the .meta files of the Unity package.")
    parser.add_argument(
        "--check",
        action="store_true",
        help="write nothing, exit with 1 where something would change",
    )
    check = parser.parse_args().check
    metas = wanted()
    there = {path for path in ROOT.rglob("*.meta") if is_imported(path.with_suffix(""))}
    stale = sorted(there - metas.keys())
    changed = [
        path for path, text in metas.items() if path not in there or path.read_text("utf-8") != text
    ]
    for path in stale:
        print(f"left over: {path.relative_to(ROOT)}")
        if not check:
            path.unlink()
    for path in changed:
        print(f"{'missing or different' if check else 'written'}: {path.relative_to(ROOT)}")
        if not check:
            path.write_text(metas[path], "utf-8")
    return 1 if check and (stale or changed) else 0


if __name__ == "__main__":
    sys.exit(main())
