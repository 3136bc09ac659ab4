from __future__ import annotations

import numpy as np
from scipy.spatial.distance import pdist

from terraport_pipeline.synth.camera_eye import CameraEye
from terraport_pipeline.synth.targets import TARGETS, place_targets


def test_targets_lie_apart_on_level_ground_and_stay_where_they_are(eye: CameraEye) -> None:
    terrain = eye.surface.terrain
    places = place_targets(7, terrain)
    assert 5 <= len(places) <= TARGETS
    assert pdist(places).min() > 25.0
    np.testing.assert_array_equal(places, place_targets(7, terrain))
    assert not np.array_equal(places, place_targets(8, terrain))
