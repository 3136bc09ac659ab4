"""Compile every pass of the package's shaders, in each of Unity's variants, against stub includes.

    python client_sdk/unity/Stubs~/Shaders/check.py [--slang]

By glslang (Debian glslang-tools); with ``--slang`` also by Slang's HLSL front end (PyPI slangpy),
which follows what is written before it is read. Variants are instancing, both eyes in one pass
(instanced, multiview, side by side), fog, the colour space, and of lit ground shadows and lights.
It finds what a compiler of HLSL finds: a wrong name, type or semantic in our own lines, a name of a
pipeline that is not listed here. No front end sees that a vertex does not pass its eye on: that is
looked for in the text. What Unity's real includes do is not found.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import itertools
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

STUBS = Path(__file__).resolve().parent
RUNTIME = STUBS.parent.parent / "Runtime"
INCLUDES = [STUBS, RUNTIME, RUNTIME / "Shaders"]
PASS = re.compile(r"(?:HLSLPROGRAM|CGPROGRAM)(.*?)(?:ENDHLSL|ENDCG)", re.DOTALL)
ENTRY = re.compile(r"#pragma (vertex|fragment) (\w+)")
EYES = ("", "STEREO_INSTANCING_ON", "STEREO_MULTIVIEW_ON", "UNITY_SINGLE_PASS_STEREO")
# Unity does not compile instancing together with multiview or side by side; stereo brings its own.
VARIANTS = [
    [keyword for keyword in keywords if keyword]
    for keywords in itertools.product(
        (*EYES, "INSTANCING_ON"), ("", "FOG_LINEAR"), ("", "UNITY_COLORSPACE_GAMMA")
    )
]

LIGHTS = (
    [],
    [
        "_MAIN_LIGHT_SHADOWS",
        "_ADDITIONAL_LIGHTS",
        "SHADOWS_SCREEN",
        "_CASTING_PUNCTUAL_LIGHT_SHADOW",
    ],
)
"""Keywords of shaders that take lights: none, and those of both pipelines at once."""

FrontEnd = Callable[[Path, str, str, list[str]], str]
"""Compile a file's entry point of a stage with keywords; what is wrong with it, or nothing."""


def stages(shader: Path) -> Iterator[tuple[int, str, str, str]]:
    """Yield number of the pass, source, stage and entry point of each program of a shader."""
    for number, body in enumerate(PASS.findall(shader.read_text("utf-8"))):
        source = "\n".join(
            line for line in body.splitlines() if not line.strip().startswith("#pragma")
        )
        # The include is relative to the shader in Unity, here to a search path.
        source = source.replace('"../Shaders/', '"Shaders/')
        for stage, entry in ENTRY.findall(body):
            yield number, source, stage, entry


def glslang(file: Path, stage: str, entry: str, keywords: list[str]) -> str:
    """Errors alone: it has no warnings about HLSL."""
    command = ["glslangValidator", "-D", "-V", "-S", stage[:4], "-e", entry]
    command += ["--auto-map-bindings", "--auto-map-locations"]
    command += [f"-I{folder}" for folder in INCLUDES] + [f"-D{keyword}" for keyword in keywords]
    command += ["-o", str(file.with_suffix(".spv")), str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    return "" if done.returncode == 0 else done.stdout + done.stderr


def slang_of(library_path: Path) -> FrontEnd:
    """Make a front end of Slang's library, by its C interface; warnings are errors."""
    library = ctypes.CDLL(str(library_path))
    library.spCreateSession.restype = ctypes.c_void_p
    library.spCreateCompileRequest.restype = ctypes.c_void_p
    library.spGetDiagnosticOutput.restype = ctypes.c_char_p
    session = ctypes.c_void_p(library.spCreateSession(None))

    def compile_by_slang(file: Path, stage: str, entry: str, keywords: list[str]) -> str:
        words = [str(file), "-lang", "hlsl", "-target", "hlsl", "-profile", "sm_6_0"]
        words += ["-stage", stage, "-entry", entry, "-o", str(file.with_suffix(".out"))]
        # A global is a parameter: what Unity's includes have throughout.
        words += ["-warnings-disable", "39019"]
        for folder in INCLUDES:
            words += ["-I", str(folder)]
        words += [f"-D{keyword}" for keyword in ["STUB_SAMPLER2D", *keywords]]
        arguments = (ctypes.c_char_p * len(words))(*(word.encode() for word in words))
        request = ctypes.c_void_p(library.spCreateCompileRequest(session))
        failed = library.spProcessCommandLineArguments(request, arguments, len(words)) < 0
        failed = failed or library.spCompile(request) < 0
        said = (library.spGetDiagnosticOutput(request) or b"").decode()
        library.spDestroyCompileRequest(request)
        return said or ("it failed and did not say why" if failed else "")

    return compile_by_slang


def find_slang() -> Path | None:
    """Find the library that slangpy brings; None where that is not installed."""
    spec = importlib.util.find_spec("slangpy")
    folders = [] if spec is None else spec.submodule_search_locations or []
    names = ("libslang-compiler.so*", "libslang-compiler*.dylib", "slang-compiler.dll")
    found = (path for folder in folders for name in names for path in Path(folder).glob(name))
    return next(found, None)


def failures(shader: Path, compile_by: FrontEnd) -> tuple[int, list[str]]:
    """Count what was compiled, and list what a front end says of what it does not take."""
    count, found = 0, []
    with tempfile.TemporaryDirectory() as folder:
        for number, source, stage, entry in stages(shader):
            file = Path(folder) / f"pass{number}.hlsl"
            file.write_text(source, "utf-8")
            lights = LIGHTS if "Lit" in source else LIGHTS[:1]
            for keywords in (chosen + lit for chosen in VARIANTS for lit in lights):
                count += 1
                answer = compile_by(file, stage, entry, keywords)
                if answer:
                    variant = " ".join(keywords) or "no keyword"
                    found.append(f"{shader.name}, pass {number}, {entry}, {variant}:\n{answer}")
    return count, found or ([] if count else [f"{shader.name}: no pass"])


def without_eye(source: Path) -> list[str]:
    """List vertex programs whose output has a place for the eye that they do not write."""
    text = source.read_text("utf-8")
    outputs = re.findall(r"struct (\w+)\s*\{[^}]*UNITY_VERTEX_OUTPUT_STEREO[^}]*\}", text)
    programs = re.findall(r"^(\w+) (\w+)\(Attributes input\)\n\{\n(.*?)^\}", text, re.M | re.S)
    return [
        f"{source.name}, {name}: {output} is returned without its eye"
        for output, name, body in programs
        if output in outputs and "UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(output)" not in body
    ]


def main() -> int:
    """Check them all; the exit code is 1 where one does not compile."""
    parser = argparse.ArgumentParser(description="compile the shaders against stub includes")
    parser.add_argument("--slang", action="store_true", help="by Slang, too (needs slangpy)")
    front_ends: dict[str, FrontEnd] = {"glslang": glslang}
    if parser.parse_args().slang:
        library = find_slang()
        if library is None:
            parser.error("no Slang: pip install slangpy")
        front_ends["Slang"] = slang_of(library)
    eyeless = [text for path in sorted(RUNTIME.rglob("*.hlsl")) for text in without_eye(path)]
    print("\n".join(eyeless))
    bad = bool(eyeless)
    for name, compile_by in front_ends.items():
        for shader in sorted(RUNTIME.rglob("*.shader")):
            count, found = failures(shader, compile_by)
            print(f"{shader.name}: {count} programs by {name}, {len(found)} refused")
            print("\n".join(found[:10]))
            bad = bad or bool(found)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
