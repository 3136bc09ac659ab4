"""3D Tiles of a scene: what is under what, where it lies, and that nothing is missing or twice."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from glb_file import read_glb, split_glb
from numpy.testing import assert_allclose, assert_array_equal

from terraport_payload import Cover, SegmentMesh
from terraport_store import CrsInfo, Scene
from terraport_store.layout import BASE
from terraport_store.tiles.base_image import BaseImage
from terraport_store.tiles.cells import CELL_RADIUS_M, CELL_SEGMENTS, cells_of, part_faces
from terraport_store.tiles.placing import place_scene
from terraport_store.tiles.scene_tiles import SceneTiles
from terraport_store.tiles.tile_glb import TileFacts, encode_tile
from terraport_store.tiles.tileset import Tileset, tile_coordinates

SAMPLE = Path(__file__).resolve().parents[2] / "data" / "sample_scene"


class Tiled:
    """A scene, its tiles, and the bytes of its parts."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.manifest = scene.manifest
        self.bounds = scene.index.bounds
        self.tiles = SceneTiles.of(
            scene.file_mesh(BASE),
            scene.cover,
            self.bounds,
            self.manifest.hand_off.deviation_m,
        )
        self.facts = TileFacts.of(self.manifest, scene.regions["regions"])
        self.parts = list(self.tiles.encode_parts(self.facts))

    def document(self, **options: Any) -> dict[str, Any]:
        tileset = Tileset.of(
            self.tiles.cells,
            self.bounds,
            options.get("placing") or place_scene(self.manifest),
            segment_uri="segments/{}.glb".format,
            part_uri="base/{}.glb".format,
            version=self.manifest.version,
        )
        document: dict[str, Any] = json.loads(b"".join(tileset.pieces(options.get("radius_m"))))
        return document

    def content(self, uri: str) -> SegmentMesh:
        folder, number = uri.removesuffix(".glb").split("/")
        if folder == "base":
            return read_glb(whole(self.parts[int(number)]))
        return self.scene.mesh(int(number))


def whole(tile: bytes) -> bytes:
    """A tile as our own reader takes it: with its codes of attributes as they are."""
    from terraport_payload.glb_container import join_glb

    document, binary = split_glb(tile)
    document["meshes"][0]["extras"] = {"terraport": {"step_m": 1.0}}
    names = document["meshes"][0]["primitives"][0]["attributes"]
    for name in [name for name in names if name.startswith("_") and "FEATURE" not in name]:
        del names[name]
    return join_glb(document, bytes(binary))


@pytest.fixture(scope="module")
def tiled():
    with Scene.open(SAMPLE) as scene:
        yield Tiled(scene)


def walk(tile: dict[str, Any], above: np.ndarray | None = None):
    """Every tile with its matrix to the Earth."""
    own = np.array(tile.get("transform", np.eye(4).ravel().tolist())).reshape(4, 4).T
    matrix = own if above is None else above @ own
    yield tile, matrix
    for child in tile.get("children", ()):
        yield from walk(child, matrix)


def ends(volume: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    middle, halves = np.array(volume["box"][:3]), np.array(volume["box"][3:]).reshape(3, 3)
    return middle - halves.sum(axis=0), middle + halves.sum(axis=0)


def moved(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.mark.parametrize("radius_m", [None, 8.0])
def test_each_segment_once_and_errors_fall_to_nothing(tiled: Tiled, radius_m) -> None:
    document = tiled.document(radius_m=radius_m)
    tiles = list(walk(document["root"]))
    uris = [tile["content"]["uri"] for tile, _ in tiles if "content" in tile]
    segments = [f"segments/{number}.glb" for number in range(len(tiled.bounds))]
    assert sorted(uris) == sorted([*segments, *(f"base/{n}.glb" for n in range(len(tiled.parts)))])
    assert document["asset"]["version"] == "1.1"
    assert document["geometricError"] > document["root"]["geometricError"]
    for tile, _ in tiles:
        for child in tile.get("children", ()):
            assert tile["geometricError"] > child["geometricError"]
        if tile.get("content", {}).get("uri", "").startswith("segments/"):
            assert tile["geometricError"] == 0
            assert ("viewerRequestVolume" in tile) == (radius_m is not None)


def test_volumes_hold_content_and_children(tiled: Tiled) -> None:
    tiles = list(walk(tiled.document()["root"]))
    for tile, matrix in tiles:
        low, high = ends(tile["boundingVolume"])
        if "content" in tile:
            places = tile_coordinates(tiled.content(tile["content"]["uri"]).positions)
            assert (places >= low - 1e-6).all()
            assert (places <= high + 1e-6).all()
        for child, below in walk({**tile, "transform": matrix.T.ravel().tolist()}):
            corners = np.stack(np.meshgrid(*np.stack(ends(child["boundingVolume"]), 1)), -1)
            places = moved(np.linalg.inv(matrix) @ below, corners.reshape(-1, 3))
            assert (places >= low - 1e-6).all()
            assert (places <= high + 1e-6).all()


def test_a_radius_is_a_volume_for_all_of_a_cell(tiled: Tiled) -> None:
    for tile, _ in walk(tiled.document(radius_m=8.0)["root"]):
        asked = [child["viewerRequestVolume"] for child in tile.get("children", ())
                 if "viewerRequestVolume" in child]  # fmt: skip
        if not asked:
            continue
        assert all(volume == asked[0] for volume in asked)
        low, high = ends(tile["boundingVolume"])
        assert_allclose(ends(asked[0]), (low - 8.0, high + 8.0))
        # Viewers that know no such volume come close by the error: 16 of 1080 lines of 60 degrees.
        assert tile["geometricError"] * 935 / 8.0 >= 15.9


def test_a_base_face_is_drawn_until_all_cells_over_it_are_refined(tiled: Tiled) -> None:
    cover, cells = tiled.scene.cover, tiled.tiles.cells
    kept = [tiled.tiles.parts[cell.kept] for cell in cells if cell.kept is not None]
    random = np.random.default_rng(0)
    for share in (0.0, 0.3, 0.7, 1.0):
        refined = random.random(len(cells)) < share
        shown = set(np.concatenate([*kept, []]).astype(int).tolist())
        for cell, is_refined in zip(cells, refined.tolist(), strict=True):
            if cell.replaced is not None and not is_refined:
                shown |= set(tiled.tiles.parts[cell.replaced].tolist())
        loaded = {
            segment
            for cell, is_refined in zip(cells, refined.tolist(), strict=True)
            if is_refined
            for segment in cell.segments.tolist()
        }
        # The scene's own rule: spec/scene-format.md, section 8.
        expected = {
            face
            for face in range(cover.base_faces)
            if not (over := cover.over(face).tolist()) or not loaded.issuperset(over)
        }
        assert shown == expected


def test_parts_have_the_bases_triangles_bit_by_bit(tiled: Tiled) -> None:
    base = tiled.tiles.base
    step_m = tiled.manifest.step_m

    def triangles(mesh: SegmentMesh, faces: np.ndarray) -> np.ndarray:
        corners = np.rint(mesh.positions[faces] / step_m).astype(np.int64).reshape(len(faces), -1)
        # Corners may be rotated, and faces be in another order.
        turns = np.stack([np.roll(corners, 3 * turn, axis=1) for turn in range(3)])
        first = np.lexsort(turns.transpose(2, 0, 1)[::-1], axis=0)[0]
        rows = turns[first, np.arange(len(faces))]
        return rows[np.lexsort(rows.T)]

    for faces, part in zip(tiled.tiles.parts, tiled.parts, strict=True):
        mesh = read_glb(whole(part))
        assert_array_equal(triangles(mesh, mesh.faces), triangles(base, base.faces[faces]))


def test_parts_show_the_bases_colours(tiled: Tiled) -> None:
    """A cut image, looked up at vertices, has the levels that the whole one has there."""
    import io

    from PIL import Image

    def levels(mesh: SegmentMesh) -> np.ndarray:
        assert mesh.texture is not None
        assert mesh.uvs is not None
        with Image.open(io.BytesIO(mesh.texture.data)) as image:
            pixels = np.asarray(image.convert("RGB")).astype(int)
        texels = mesh.uvs * [mesh.texture.width, mesh.texture.height]
        column, row = np.minimum(texels.astype(int), [pixels.shape[1] - 1, pixels.shape[0] - 1]).T
        return pixels[row, column]

    base = tiled.tiles.base
    for faces, part in zip(tiled.tiles.parts, tiled.parts, strict=True):
        mesh = read_glb(whole(part))
        assert mesh.texture is not None
        assert mesh.texture.width * mesh.texture.height < 2048 * 2048
        used = np.unique(base.faces[faces])
        # By place and coordinates in the whole image; vertices on seams stand several times.
        whole_levels = dict(
            zip(map(tuple, base.positions[used].tolist()), levels(base)[used], strict=True)
        )
        once = {tuple(place) for place in base.positions[used].tolist()}
        assert len(once) <= len(used)
        off = [
            np.abs(level - whole_levels[tuple(place)]).max()
            for place, level in zip(mesh.positions.tolist(), levels(mesh), strict=True)
        ]
        assert np.median(off) <= 2


def test_an_image_that_cannot_be_decoded_stays_whole(tiled: Tiled, monkeypatch) -> None:
    monkeypatch.setattr("terraport_store.tiles.base_image._FORMATS", {})
    image = BaseImage(tiled.tiles.base.texture)
    assert image.cut(tiled.tiles.base) is tiled.tiles.base


def test_transforms_are_right_to_a_millimetre(tiled: Tiled) -> None:
    placing = place_scene(tiled.manifest)
    assert not placing.is_local
    for tile, matrix in walk(tiled.document()["root"]):
        if "children" in tile and "content" not in tile:
            continue  # the root: nothing of its own
        low, high = ends(tile["boundingVolume"])
        corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1)), -1).reshape(-1, 3)
        away_m = np.linalg.norm(moved(matrix, corners) - placing.earth(corners), axis=1)
        assert away_m.max() < 1e-3


def test_a_wide_scene_is_right_to_a_millimetre_too(tiled: Tiled) -> None:
    """Two kilometres of segments: one matrix would be 78 mm off."""
    grid = np.stack(np.meshgrid(np.arange(-1000, 1000, 25.0), np.arange(-1000, 1000, 25.0)), -1)
    x, z = grid.reshape(-1, 2).T
    bounds = np.stack([x, 0 * x, z, x + 25, 0 * x + 10, z + 25], axis=1)
    cells = cells_of(bounds)
    assert sorted(np.concatenate(cells).tolist()) == list(range(len(bounds)))
    placing = place_scene(tiled.manifest)
    worst_m = 0.0
    for segments in cells:
        low, high = bounds[segments, :3].min(axis=0), bounds[segments, 3:].max(axis=0)
        assert np.linalg.norm(high - low) / 2 <= CELL_RADIUS_M
        corners = tile_coordinates(np.concatenate([bounds[segments, :3], bounds[segments, 3:]]))
        matrix = placing.matrix_at(tile_coordinates((low + high)[None] / 2)[0])
        away_m = np.linalg.norm(moved(matrix, corners) - placing.earth(corners), axis=1)
        worst_m = max(worst_m, away_m.max())
    assert worst_m < 1e-3
    one = placing.matrix_at(np.zeros(3))
    corners = tile_coordinates(bounds[:, :3])
    assert np.linalg.norm(moved(one, corners) - placing.earth(corners), axis=1).max() > 0.05


def test_few_segments_to_a_cell_and_one_far_away_alone() -> None:
    bounds = np.zeros((30, 6))
    bounds[:, 3:] = 1
    bounds[:, [0, 3]] += np.arange(30)[:, None]
    bounds[29, [0, 3]] += 5000
    cells = cells_of(bounds)
    assert max(len(cell) for cell in cells) <= CELL_SEGMENTS
    assert [29] in [cell.tolist() for cell in cells]


def test_without_a_place_on_earth_a_scene_is_local(tiled: Tiled) -> None:
    bare = tiled.manifest.model_copy(update={"crs": None})
    odd = tiled.manifest.model_copy(update={"crs": CrsInfo(name="our own grid", wkt="nonsense")})
    for manifest, said in ((bare, "states no"), (odd, "our own grid")):
        placing = place_scene(manifest)
        assert placing.is_local
        assert said in placing.why_local
        tiles = list(walk(tiled.document(placing=placing)["root"]))
        assert not any("transform" in tile for tile, _ in tiles)


def test_heights_can_be_shifted(tiled: Tiled) -> None:
    plain = place_scene(tiled.manifest).earth(np.zeros((1, 3)))
    shifted = place_scene(tiled.manifest, height_shift_m=45.0).earth(np.zeros((1, 3)))
    assert_allclose(np.linalg.norm(shifted - plain), 45.0, atol=1e-6)


def test_faces_that_no_segment_covers_never_go() -> None:
    cover = Cover(np.array([0, 0, 2, 3, 3], np.uint32), np.array([0, 1, 1], np.uint32))
    bounds = np.array([[0, 0, 0, 1, 1, 1], [500, 0, 0, 501, 1, 1]], np.float32)
    middles = np.array([[0.0, 0, 0], [1, 0, 0], [500, 0, 0], [499, 0, 0]])
    parts = part_faces(cover, cells_of(bounds), bounds, middles)
    assert [faces.tolist() for faces in parts.replaced] == [[1], [1, 2]]
    assert [faces.tolist() for faces in parts.kept] == [[0], [3]]


def test_regions_without_a_name_have_no_column_of_names(tiled: Tiled) -> None:
    rows = tiled.scene.regions["regions"]
    facts = TileFacts.of(tiled.manifest, rows, [""] * len(rows))
    document, _ = split_glb(encode_tile(tiled.scene.mesh(5), facts))
    metadata = document["extensions"]["EXT_structural_metadata"]
    (table,) = metadata["propertyTables"]
    assert set(metadata["schema"]["classes"]["region"]["properties"]) - set(
        table["properties"]
    ) == {"label"}
    assert "required" not in metadata["schema"]["classes"]["region"]["properties"]["label"]
    assert all(view["byteLength"] > 0 for view in document["bufferViews"])


def test_regions_and_attributes_are_named(tiled: Tiled) -> None:
    labels = [f"ground {number}" for number in range(tiled.manifest.counts.regions)]
    rows = tiled.scene.regions["regions"]
    mesh = tiled.scene.mesh(5)
    document, binary = split_glb(encode_tile(mesh, TileFacts.of(tiled.manifest, rows, labels)))
    metadata = document["extensions"]["EXT_structural_metadata"]
    (table,) = metadata["propertyTables"]
    here = np.unique(mesh.region_ids)
    assert table["count"] == len(here)

    def data(view: int) -> bytes:
        row = document["bufferViews"][view]
        assert row["byteOffset"] % 8 == 0
        return bytes(binary[row["byteOffset"] : row["byteOffset"] + row["byteLength"]])

    columns = table["properties"]
    assert np.frombuffer(data(columns["region"]["values"]), "<u2").tolist() == here.tolist()
    ends_at = np.frombuffer(data(columns["label"]["stringOffsets"]), "<u4")
    texts = data(columns["label"]["values"])
    named = [texts[a:b].decode() for a, b in itertools.pairwise(ends_at)]
    assert named == [labels[region] for region in here]
    assert ends_at[-1] == len(texts)  # or the 3D Tiles validator counts an error
    areas = np.frombuffer(data(columns["area_m2"]["values"]), "<f4")
    assert_allclose(areas, [rows[region]["area_m2"] for region in here], rtol=1e-6)
    # 3D Metadata: value = offset + scale * code / 65535.
    grade = metadata["schema"]["classes"]["vertex"]["properties"]["grade"]
    (info,) = tiled.manifest.attributes
    assert grade["normalized"]
    assert grade["noData"] == 65535
    assert_allclose(grade["offset"] + grade["scale"] * 1000 / 65535, info.offset + 1000 * info.step)
    primitive = document["meshes"][0]["primitives"][0]
    assert document["accessors"][primitive["attributes"]["_GRADE"]]["normalized"]
    (features,) = primitive["extensions"]["EXT_mesh_features"]["featureIds"]
    assert features["featureCount"] == len(here)
    # Drawn as photographed, whatever lamps the viewer has.
    assert [material["extensions"] for material in document["materials"]] == [
        {"KHR_materials_unlit": {}}
    ]
    assert "KHR_materials_unlit" in document["extensionsUsed"]
    assert "KHR_materials_unlit" not in document["extensionsRequired"]
    assert features["propertyTable"] == 0
