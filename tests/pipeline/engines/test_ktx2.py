from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from terraport_payload import Texture
from terraport_pipeline.engines.images import encode_image
from terraport_pipeline.engines.ktx2 import encode_ktx2, require_encoder
from terraport_pipeline.errors import EngineError, OptionError

PIXELS = (np.arange(64 * 32 * 3) % 251).reshape(32, 64, 3).astype(np.uint8)

HEADER = r"\253KTX 20\273\r\n\032\n\0\0\0\0\1\0\0\0\100\0\0\0\040\0\0\0"
"""Of a file of 64 x 32 pixels, for printf."""


def program(folder: Path, body: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = folder / "basisu"
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")


def test_without_the_program_the_error_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(OptionError, match="--texture-format webp or jpeg"):
        require_encoder()


def test_the_program_gets_a_png_and_its_file_comes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = f"""echo "$@" > {tmp_path}/told; for last; do :; done; printf '{HEADER}' > "$last\""""
    program(tmp_path, body, monkeypatch)
    data = encode_image(PIXELS, "ktx2", 40)
    assert Texture.of(data).media_type == "image/ktx2"
    assert "-ktx2 -mipmap -q 102 -no_multithreading -file" in (tmp_path / "told").read_text()


def test_a_program_that_fails_is_quoted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program(tmp_path, "echo out of luck; exit 3", monkeypatch)
    with pytest.raises(EngineError, match="ended with 3: out of luck"):
        encode_ktx2(PIXELS, 50)
