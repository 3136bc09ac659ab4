"""Compile every pass of the package's shaders by glslang, against the stub includes beside this.

    python client_sdk/unity/Stubs~/Shaders/check.py

Needs glslangValidator (Debian glslang-tools). It finds what a compiler of HLSL finds: a wrong name,
type or semantic in our own lines, and a name of a pipeline that is not listed here. It does not
find what Unity's real includes do, nor anything of stereo and keywords.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

STUBS = Path(__file__).resolve().parent
RUNTIME = STUBS.parent.parent / "Runtime"
PASS = re.compile(r"(?:HLSLPROGRAM|CGPROGRAM)(.*?)(?:ENDHLSL|ENDCG)", re.DOTALL)
ENTRY = re.compile(r"#pragma (vertex|fragment) (\w+)")
COLOUR_SPACES = ("", "#define UNITY_COLORSPACE_GAMMA 1\n")


def failures(shader: Path) -> list[str]:
    """List what the compiler says of each pass and stage that it does not take."""
    found = []
    passes = PASS.findall(shader.read_text("utf-8"))
    if not passes:
        found.append(f"{shader.name}: no pass")
    for number, body in enumerate(passes):
        stages = ENTRY.findall(body)
        source = "\n".join(
            line for line in body.splitlines() if not line.strip().startswith("#pragma")
        )
        for stage, entry in stages:
            for colour_space in COLOUR_SPACES:
                answer = compile_hlsl(
                    shader, colour_space + source, "vert" if stage == "vertex" else "frag", entry
                )
                if answer:
                    found.append(f"{shader.name}, pass {number}, {entry}:\n{answer}")
    return found


def compile_hlsl(shader: Path, source: str, stage: str, entry: str) -> str:
    """Give what glslang says; nothing where it takes it."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pass.hlsl"
        # The include is relative to the shader in Unity, here to a search path.
        file.write_text(source.replace('"../Shaders/', '"Shaders/'), "utf-8")
        command = [
            "glslangValidator",
            "-D",
            "-V",
            "-S",
            stage,
            "-e",
            entry,
            "--auto-map-bindings",
            "--auto-map-locations",
        ]
        command += [
            f"-I{STUBS}",
            f"-I{shader.parent.parent}",
            f"-I{RUNTIME / 'Shaders'}",
            "-o",
            str(Path(folder) / "out.spv"),
            str(file),
        ]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    return "" if done.returncode == 0 else done.stdout + done.stderr


def main() -> int:
    """Check them all; the number of failures decides."""
    found = [text for shader in sorted(RUNTIME.rglob("*.shader")) for text in failures(shader)]
    print("\n".join(found) if found else "every pass compiles")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
