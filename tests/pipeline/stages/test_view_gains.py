from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from photo_scene import EXPOSURES, photo_scene

from terraport_pipeline.engines.rays import RayScene
from terraport_pipeline.geometry.photos.photo_samples import neutral_gains
from terraport_pipeline.stages.view_gains import find_gains, view_gains


def undoing_gains(exposures: tuple[float, ...]) -> np.ndarray:
    """h that undoes each exposure."""
    return np.array(exposures) ** (-1 / 2.4)


@pytest.fixture(scope="module")
def site():
    return photo_scene()


def test_exposures_are_recovered_within_two_per_cent(site) -> None:
    rays = RayScene(site.mesh.vertices, site.mesh.faces, threads=1)
    solution = find_gains(site.mesh, site.views, site, rays)
    np.testing.assert_allclose(
        solution.gains[:-1, :3].mean(axis=1), undoing_gains(EXPOSURES), rtol=0.02
    )
    assert solution.facts["gain_spread_after"] < 0.5 * solution.facts["gain_spread_before"]
    assert (solution.gains[-1] == neutral_gains(0)[-1]).all()  # the cloud is the reference


def test_without_colours_the_photos_keep_their_mean(site) -> None:
    grey = replace(site.mesh, colours=np.full_like(site.mesh.colours, 128))
    rays = RayScene(grey.vertices, grey.faces, threads=1)
    gains = view_gains(grey, site.views, site, rays)[:-1, :3].mean(axis=1)
    ratio = gains / undoing_gains(EXPOSURES)
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=0.03)
    assert abs(np.log(gains).mean()) < 0.05


def test_vignetting_is_found(site) -> None:
    dark = []
    for photo in site.photos:
        rows, columns = np.indices(photo.shape[:2]) + 0.5
        square = ((columns - 160) ** 2 + (rows - 120) ** 2) / (160**2 + 120**2)
        dark.append(np.rint((photo + 14.025) * (1 - 0.15 * square)[..., None] - 14.025))
    shaded = replace(site, photos=[np.clip(photo, 0, 255).astype(np.uint8) for photo in dark])
    rays = RayScene(site.mesh.vertices, site.mesh.faces, threads=1)
    a, b = view_gains(site.mesh, site.views, shaded, rays)[0, 3:]
    half = 1 + 0.5 * (a + 0.5 * b)
    assert half == pytest.approx(1 / (1 - 0.15 * 0.5), rel=0.02)
    plain = view_gains(site.mesh, site.views, site, rays)[0, 3:]
    assert abs(plain[0] + plain[1]) < 0.05


def test_nothing_to_compare_changes_nothing(site) -> None:
    rays = RayScene(site.mesh.vertices, site.mesh.faces, threads=1)
    assert (view_gains(site.mesh, [], site, rays) == neutral_gains(0)).all()
    nothing = replace(site.mesh, faces=site.mesh.faces[:0])
    assert (view_gains(nothing, site.views, site, rays) == neutral_gains(6)).all()
