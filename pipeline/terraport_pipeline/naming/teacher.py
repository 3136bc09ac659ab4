"""Learn names from strokes, and say of all ground what it is called and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import shapely

from terraport_payload.types import Float32, Float64, Int32, Int64
from terraport_pipeline.errors import OptionError
from terraport_pipeline.geometry.clouds.height_changes import HEIGHT_CHANGE
from terraport_pipeline.geometry.learning.forest import Forest
from terraport_pipeline.geometry.learning.ground_units import (
    GroundUnits,
    cell_size_m,
    ground_features,
    ground_units,
)
from terraport_pipeline.geometry.learning.unit_patches import Patches, unit_patches
from terraport_pipeline.geometry.learning.unit_votes import evened_out
from terraport_pipeline.geometry.mesh.adjacency import components
from terraport_pipeline.geometry.regions.pool_refine import join_nearest
from terraport_pipeline.geometry.regions.small_pieces import absorb_small
from terraport_pipeline.naming.drawings import Drawing
from terraport_pipeline.naming.model_file import MAX_CLASSES, GroundModel
from terraport_pipeline.naming.outlines import PlaceFinder
from terraport_pipeline.naming.recut import Cut
from terraport_pipeline.published.ground import Ground

__all__ = ["STROKE_CELLS", "Answer", "Teacher", "stroke_areas"]

STROKE_CELLS: Final = 4.0
"""Width of a line or point, squares, where nobody says another."""

_TREES: Final = 100

_LEAST_LEAF: Final = 2
"""Units in a leaf: strokes are few."""

_MOST_UNITS: Final = 3_000
"""Of one name that the forest is grown from: every stroke counts, however large one of them is."""

_SMALL_CELLS: Final = 64.0
"""Regions below so many squares join what they touch, unless another least area is asked for."""

_SEED: Final = 1


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a model says of the ground."""

    names: tuple[str, ...]
    votes: Float64
    """(U, C) probability of every name, by unit."""
    best: Int32
    """(F,) name of every face."""
    sure: Float64
    """(F,) probability of that name."""

    @property
    def unsure(self) -> Float64:
        """(U,) 0 where one name stands alone, 1 where two are equally likely."""
        if self.votes.shape[1] < 2:
            return np.zeros(len(self.votes))
        ordered = np.partition(self.votes, -2, axis=1)
        doubt: Float64 = 1.0 - (ordered[:, -1] - ordered[:, -2])
        return doubt


class Teacher:
    """The ground of a scene with its features, which are measured once and kept.

    Parameters
    ----------
    ground : Ground
    cell_m : float, optional
        Side of the squares that features are measured in; None: by the density of the faces.
    attributes : sequence of str, optional
        Of the survey, to look at; None: all.
    threads : int
    before : Teacher, optional
        Of the same ground under other regions: its features are taken where the units are the same.
    """

    def __init__(
        self,
        ground: Ground,
        *,
        cell_m: float | None = None,
        attributes: Sequence[str] | None = None,
        threads: int = 1,
        before: Teacher | None = None,
    ) -> None:
        self._before = before
        self.ground = ground
        self.threads = threads
        there = [name for name in ground.mesh.attributes if name != HEIGHT_CHANGE]
        self.attributes = tuple(there if attributes is None else attributes)
        lacking = [name for name in self.attributes if name not in there]
        if lacking:
            raise OptionError(
                f"the model looks at {', '.join(map(repr, lacking))}, which this survey does not "
                "have; teach it with strokes of its own"
            )
        if cell_m is None:
            cell_m = cell_size_m(float(ground.area.sum()), len(ground.area))
        self.cell_m = cell_m

    @cached_property
    def slope_deg(self) -> Float64:
        """(F,) 0 level, 90 vertical or overhanging."""
        mesh = self.ground.mesh
        a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
        normal = np.cross((b - a).astype(np.float64), (c - a).astype(np.float64))
        up = normal[:, 1] / np.maximum(np.linalg.norm(normal, axis=1), 1e-30)
        slope: Float64 = np.degrees(np.arccos(np.clip(up, 0.0, 1.0)))
        return slope

    @cached_property
    def units(self) -> GroundUnits:
        """Faces taken together."""
        try:
            return ground_units(self.ground.centres, self.slope_deg, self.cell_m)
        except ValueError as error:
            raise OptionError(f"{error}; take a larger --cell-m") from None

    @cached_property
    def features(self) -> Float32:
        """(U, K) see ``GroundModel.features``."""
        if self._same_units():
            assert self._before is not None
            return self._before.features
        attributes = self._measured.shape[1] - 2 * len(self.attributes)
        parts = np.split(self._measured, [attributes], axis=1)
        return np.concatenate([parts[0], self.patches.features, parts[1]], axis=1)

    @cached_property
    def quartiles(self) -> Float32:
        """(3, K) of every feature over the ground: the same for every stroke."""
        if self._same_units():
            assert self._before is not None
            return self._before.quartiles
        quartiles: Float32 = np.percentile(self.features, [25, 50, 75], axis=0).astype(np.float32)
        return quartiles

    @cached_property
    def _measured(self) -> Float32:
        ground, mesh = self.ground, self.ground.mesh
        return ground_features(
            self.units, mesh.faces, mesh.colours, ground.centres, ground.area, self.slope_deg,
            {name: mesh.attributes[name] for name in self.attributes},
        )  # fmt: skip

    @cached_property
    def patches(self) -> Patches:
        """Pieces of ground between borders."""
        if self._same_units():
            assert self._before is not None
            return self._before.patches
        ground, mesh, units = self.ground, self.ground.mesh, self.units
        faces = np.bincount(units.of_face, minlength=units.count)
        heights = np.bincount(units.of_face, ground.centres[:, 1], units.count) / faces
        return unit_patches(
            units, mesh.vertices, mesh.faces, mesh.colours, ground.pairs, self._measured, heights
        )

    def _same_units(self) -> bool:
        before, units = self._before, self.units
        return before is not None and (
            (before.cell_m, before.attributes) == (self.cell_m, self.attributes)
            and before.units.corner_m == units.corner_m
            and np.array_equal(before.units.square, units.square)
            and np.array_equal(before.units.steep, units.steep)
        )

    @cached_property
    def _finder(self) -> PlaceFinder:
        return PlaceFinder(self.ground.centres[:, [0, 2]])

    def learn(self, strokes: Sequence[Drawing]) -> tuple[GroundModel, dict[str, int]]:
        """Grow a forest from strokes.

        Parameters
        ----------
        strokes : sequence of Drawing
            Areas with a name, from :func:`stroke_areas`; two names or more.

        Returns
        -------
        GroundModel
            Of the same ground and strokes always the same.
        dict of str to int
            Units that every name was learned from.

        Raises
        ------
        OptionError
            Fewer than two names, more than 64, or a name none of whose strokes is on the ground.
        """
        names = tuple(sorted({stroke.name for stroke in strokes if stroke.name}))
        if not 2 <= len(names) <= MAX_CLASSES:
            raise OptionError(
                f"strokes of {len(names)} names, expected 2 to {MAX_CLASSES}: what is not road is "
                "something too"
            )
        rows, kinds, counts = [], [], {}
        for kind, name in enumerate(names):
            found = [
                self.units.of_face[self._finder.inside(stroke.shape)]
                for stroke in strokes
                if stroke.name == name
            ]
            units = np.unique(np.concatenate(found))
            if not len(units):
                raise OptionError(f"no stroke of {name!r} is on the ground of the scene")
            # Evenly over all of its strokes.
            step = max(1, math.ceil(len(units) / _MOST_UNITS))
            rows.append(units[::step])
            kinds.append(np.full(len(rows[-1]), kind))
            counts[name] = len(units)
        forest = _grown(self.features[np.concatenate(rows)], np.concatenate(kinds), self.threads)
        low, middle, high = self.quartiles
        model = GroundModel(names, self.cell_m, self.attributes, forest, middle, high - low)
        return model, counts

    def answer(self, model: GroundModel) -> Answer:
        """Say of all ground what a model calls it."""
        features = model.aligned(self.features, self.quartiles[1])
        likely = model.forest.predict(features, threads=self.threads)
        votes = evened_out(likely, self.patches.hold)
        best = votes.argmax(axis=1).astype(np.int32)
        of_face = self.units.of_face
        return Answer(model.names, votes, best[of_face], votes.max(axis=1)[of_face])

    def cut(self, answer: Answer, least_m2: float | None = None) -> Cut:
        """Make regions of an answer: connected pieces of one name.

        Parameters
        ----------
        answer : Answer
        least_m2 : float, optional
            Smaller ones join what they touch; None: 64 squares.

        Returns
        -------
        Cut
            Every piece with its name, and its confidence: the mean probability of its faces' name,
            by area.
        """
        ground = self.ground
        least = _SMALL_CELLS * self.cell_m**2 if least_m2 is None else least_m2
        best = absorb_small(answer.best, ground.pairs, ground.mesh.vertices, ground.area, least)
        pieces, count = components(len(best), ground.pairs[0], labels=best)
        kind = np.zeros(count, np.int32)
        kind[pieces] = best
        area = np.maximum(ground.area, 1e-12)
        # What touches nothing larger goes with what is nearest.
        small = np.bincount(pieces, area, minlength=count) < least
        if small.any() and not small.all():
            pieces = join_nearest(ground.mesh.vertices, ground.mesh.faces, pieces, small)
            used, dense = np.unique(pieces, return_inverse=True)
            pieces, kind = dense.astype(np.int32), kind[used]
        of_name = answer.votes[self.units.of_face, kind[pieces]]
        sure = np.bincount(pieces, area * of_name) / np.bincount(pieces, area)
        names = {piece: answer.names[k] for piece, k in enumerate(kind.tolist())}
        facts = {
            piece: {"class": names[piece], "confidence": round(value, 3)}
            for piece, value in enumerate(sure.tolist())
        }
        return Cut(pieces, names, facts)


def stroke_areas(drawings: Sequence[Drawing], width_m: float) -> tuple[Drawing, ...]:
    """Give strokes their width, where they say none this: they reach half of it to every side."""
    return tuple(
        replace(d, shape=shapely.buffer(d.shape, (d.width_m or width_m) / 2))
        if shapely.get_dimensions(d.shape) < 2
        else d
        for d in drawings
    )


def _grown(rows: Float32, kinds: Int64, threads: int) -> Forest:
    """Grow a forest with scikit-learn and take its arrays."""
    from sklearn.ensemble import ExtraTreesClassifier

    grower: Any = ExtraTreesClassifier(
        _TREES,
        min_samples_leaf=_LEAST_LEAF,
        class_weight="balanced",
        random_state=_SEED,
        n_jobs=threads,
    )
    grower.fit(rows, kinds)
    trees = [estimator.tree_ for estimator in grower.estimators_]
    roots = np.concatenate([[0], np.cumsum([tree.node_count for tree in trees])[:-1]])

    def moved(children: Any, root: int) -> Any:
        return np.where(children < 0, -1, children + root)

    value = np.concatenate([tree.value[:, 0, :] for tree in trees])
    return Forest(
        roots.astype(np.int64),
        np.concatenate(
            [moved(t.children_left, r) for t, r in zip(trees, roots, strict=True)]
        ).astype(np.int32),
        np.concatenate(
            [moved(t.children_right, r) for t, r in zip(trees, roots, strict=True)]
        ).astype(np.int32),
        np.concatenate([np.maximum(tree.feature, -1) for tree in trees]).astype(np.int32),
        np.concatenate([tree.threshold for tree in trees]).astype(np.float64),
        (value / value.sum(axis=1, keepdims=True)).astype(np.float32),
    )
