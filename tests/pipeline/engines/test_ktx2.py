from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from terraport_payload import Texture
from terraport_pipeline.engines import ktx2
from terraport_pipeline.engines.images import encode_image
from terraport_pipeline.errors import EngineError, OptionError

X, Y = np.meshgrid(np.arange(64), np.arange(32))
PIXELS = np.stack([X * 4, Y * 8, (X ^ Y) * 4], axis=2).astype(np.uint8)


def test_images_stay_compressed_on_a_gpu_with_all_their_levels() -> None:
    data = encode_image(PIXELS, "ktx2", 50)
    texture = Texture.of(data)
    assert (texture.media_type, texture.width, texture.height) == ("image/ktx2", 64, 32)
    assert texture.bits == 4
    levels, scheme = struct.unpack_from("<II", data, 40)
    assert (levels, scheme) == (7, 1), "down to 1 x 1, and ETC1S"


def test_same_pixels_give_the_same_bytes_and_quality_costs() -> None:
    low = encode_image(PIXELS, "ktx2", 10)
    assert low == encode_image(PIXELS, "ktx2", 10)
    assert len(low) < len(encode_image(PIXELS, "ktx2", 100))


def test_without_node_the_error_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setattr(ktx2, "_node_of_wheel", lambda: None)
    with pytest.raises(OptionError, match=r"pip install 'terraport\[ktx2\]'.*webp or jpeg"):
        ktx2.require_encoder()


def test_without_the_encoder_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ktx2, "_ENCODER", tmp_path / "basis_encoder.wasm")
    with pytest.raises(OptionError, match="built without the viewer"):
        ktx2.require_encoder()


def test_a_node_that_fails_is_quoted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    node = tmp_path / "node"
    node.write_text("#!/bin/sh\ncat >/dev/null; echo out of luck >&2; exit 3\n")
    node.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    with pytest.raises(EngineError, match="ended with 3: out of luck"):
        ktx2.encode_ktx2(PIXELS, 50)


def test_an_image_beyond_what_the_encoder_takes_is_refused() -> None:
    with pytest.raises(OptionError, match="4096 x 4096 as ktx2"):
        ktx2.encode_ktx2(np.zeros((4096, 4096, 3), np.uint8), 50)
