from __future__ import annotations

import builtins
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from payload.images import ktx2, pillow
from store.tiny_scene import lattice_mesh, textured

from terraport.errors import MissingExtraError, UsageError
from terraport.mesh import concatenate
from terraport.textures import decode_texture, merge_textures, vertex_colours
from terraport_payload import SegmentMesh, Texture


def plain_image(level: int, width: int = 32, height: int = 16) -> bytes:
    import io

    import PIL.Image

    out = io.BytesIO()
    PIL.Image.new("RGB", (width, height), (level, 0, 255 - level)).save(out, "PNG")
    return out.getvalue()


def test_pixels_of_every_kind() -> None:
    for kind in ("JPEG", "PNG", "WEBP"):
        pixels = decode_texture(Texture.of(pillow(kind)))
        assert pixels.shape == (8, 16, 3)
        assert pixels.dtype == np.uint8
    with pytest.raises(UsageError, match="image/ktx2 is an image that Pillow cannot read"):
        decode_texture(Texture.of(ktx2()))
    with pytest.raises(UsageError, match="image/jpeg"):
        decode_texture(Texture.of(pillow("JPEG")[:220]))


def test_without_pillow_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith("PIL"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match="pillow"):
        decode_texture(Texture.of(pillow("JPEG")))


def test_vertex_colours_are_the_texels_there() -> None:
    mesh = textured(lattice_mesh(0, 0, 3), pillow("PNG"))
    colours = vertex_colours(mesh)
    assert colours is not None
    assert mesh.uvs is not None
    pixels = decode_texture(Texture.of(pillow("PNG")))
    column = np.minimum((mesh.uvs[:, 0] * 16).astype(int), 15)
    row = np.minimum((mesh.uvs[:, 1] * 8).astype(int), 7)
    assert np.array_equal(colours, pixels[row, column])
    coloured = lattice_mesh(0, 0, 3)
    assert vertex_colours(coloured) is coloured.colours
    assert vertex_colours(replace(coloured, colours=None)) is None


def pieces(count: int, **size: int) -> list[SegmentMesh]:
    return [textured(lattice_mesh(i, 0, 2), plain_image(20 * i, **size)) for i in range(count)]


def test_images_become_one_and_every_vertex_keeps_its_colour() -> None:
    meshes = pieces(7)
    whole = concatenate(meshes)
    assert whole.texture is not None
    assert whole.colours is None
    assert (whole.texture.width, whole.texture.height) == (64, 64)
    # A vertex on the rim of its image may show half of the neighbour's: look a texel inwards.
    inner = [replace(mesh, uvs=0.9 * mesh.uvs + np.float32(0.05)) for mesh in meshes]
    uvs, texture = merge_textures(inner)
    colours = vertex_colours(replace(whole, uvs=uvs, texture=texture))
    expected = np.concatenate([vertex_colours(mesh) for mesh in inner])
    assert colours is not None
    assert np.abs(colours.astype(int) - expected).max() <= 4  # JPEG


def test_one_image_stays_as_it_is() -> None:
    (mesh,) = pieces(1)
    assert concatenate([mesh]).texture == mesh.texture


def test_images_that_do_not_fit_are_halved() -> None:
    meshes = pieces(3, width=4096, height=2048)
    _, texture = merge_textures(meshes)
    assert max(texture.width, texture.height) == 4096
    assert vertex_colours(replace(meshes[1], texture=texture)) is not None


def test_textured_and_coloured_together_have_vertex_colours() -> None:
    (mesh,) = pieces(1)
    both = concatenate([mesh, lattice_mesh(4, 0, 2)])
    assert both.texture is None
    assert both.uvs is None
    assert both.colours is not None
    assert both.colours[: len(mesh.positions)].tolist() == [[0, 0, 255]] * len(mesh.positions)
