"""Facts added up over tiles are the facts of the whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from coloured_ground import cut_mesh, ground
from pipeline.mesh_facts import region_facts

from terraport_pipeline.geometry.mesh.adjacency import face_pairs
from terraport_pipeline.geometry.regions.region_facts import add_borders
from terraport_pipeline.geometry.regions.region_totals import (
    add_totals,
    slope_bins,
    spread_totals,
    tile_totals,
    totals_document,
)
from terraport_pipeline.geometry.tiles.tile_seams import match_seams, open_edges


def test_facts_over_tiles_are_those_of_the_whole() -> None:
    mesh = ground(40)
    mesh.attributes["height"][::7] = np.nan
    regions = (mesh.vertices[mesh.faces[:, 0], 0] // 16).astype(np.int32)
    count = int(regions.max()) + 1
    # The facts of the mesh in one piece.
    whole = region_facts(
        mesh.vertices, mesh.faces, mesh.colours, regions, attributes=mesh.attributes,
        roughness_scale_m=4.0,
    )  # fmt: skip
    # Totals of nine pieces, added up; each numbers its regions densely by itself.
    pieces = cut_mesh(mesh, 3)
    totals, edges, labels = None, [], []
    for piece, rows in pieces:
        pairs = face_pairs(piece.faces, len(piece.vertices))
        present, dense = np.unique(regions[rows], return_inverse=True)
        piece_totals = tile_totals(
            piece.vertices, piece.faces, piece.colours, dense.astype(np.int32), len(present),
            attributes=piece.attributes, pairs=pairs, roughness_scale_m=4.0, bins=slope_bins(count),
        )  # fmt: skip
        piece_totals = spread_totals(piece_totals, present.astype(np.int32), count)
        totals = piece_totals if totals is None else add_totals(totals, piece_totals)
        edges.append(open_edges(piece.vertices, piece.faces, pairs))
        labels.append(regions[rows])
    assert totals is not None
    # Borders that run along seams are in no piece: add them.
    seams = match_seams(edges)
    sides = np.array(
        [
            [labels[t][f] for t, f in zip(tiles, faces, strict=True)]
            for tiles, faces in zip(seams.tiles, seams.faces, strict=True)
        ],
        np.int32,
    )
    crossing = sides[:, 0] != sides[:, 1]
    touching, border_m = add_borders(
        np.concatenate([totals.touching, sides[crossing]]),
        np.concatenate([totals.border_m, seams.length_m[crossing]]),
    )
    # Counts and bounds are equal, sums to rounding, the slope's percentile to about a bin.
    document = totals_document(
        replace(totals, touching=touching, border_m=border_m), ["height"], 4.0
    )
    assert document["roughness_scale_m"] == 4.0
    assert len(document["regions"]) == len(whole["regions"]) == count
    for mine, theirs in zip(document["regions"], whole["regions"], strict=True):
        assert list(mine) == list(theirs)
        for name in ("id", "faces", "bounds", "mean_colour"):
            assert mine[name] == theirs[name]
        for name in ("area_m2", "plan_area_m2", "roughness_m"):
            assert mine[name] == pytest.approx(theirs[name], rel=1e-6, abs=1e-4)
        assert mine["centroid"] == pytest.approx(theirs["centroid"], abs=2e-3)
        assert mine["slope_deg"]["p90"] == pytest.approx(theirs["slope_deg"]["p90"], abs=0.11)
        for name, value in theirs["attributes"]["height"].items():
            assert mine["attributes"]["height"][name] == pytest.approx(value, rel=1e-9)
        assert [n["region"] for n in mine["neighbours"]] == [
            n["region"] for n in theirs["neighbours"]
        ]
        for a, b in zip(mine["neighbours"], theirs["neighbours"], strict=True):
            assert a["border_m"] == pytest.approx(b["border_m"], abs=2e-3)


def test_bins_are_bounded() -> None:
    assert slope_bins(20) == 1800
    assert slope_bins(65_535) * 65_535 <= 2**24


def test_a_region_without_area_has_a_middle_and_a_colour() -> None:
    vertices = np.array([[1.0, 2, 3], [1, 2, 3], [1, 2, 3]], np.float32)
    faces, regions = np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32)
    colours = np.full((3, 3), 90, np.uint8)
    totals = tile_totals(
        vertices, faces, colours, regions, 1,
        attributes={}, pairs=face_pairs(faces, 3), roughness_scale_m=1.0, bins=90,
    )  # fmt: skip
    row = totals_document(totals, [], 1.0)["regions"][0]
    assert row["centroid"] == [1.0, 2.0, 3.0]
    assert row["mean_colour"] == [90.0, 90.0, 90.0]
