"""Feet on the ground that is shown: 200 m over detail and base, beside the Python SDK."""

from __future__ import annotations

from engines.programs import Client
from engines.walk import BOUND_M, LANDING, STEPS, places, shown_by_the_sdk
from faults.service import Service


def test_feet_stand_on_what_is_shown(client: Client, server: Service) -> None:
    url = f"{server.url}/scenes/grid"
    ground = shown_by_the_sdk(url)
    walk = places().tolist()
    steps = [f"stand:{x!r},100,{z!r}" for x, z in walk]
    landed = client.land(url, "land:" + ",".join(map(str, LANDING)), *steps, staged=1)
    assert landed.exit_code == 0, landed.output
    feet = landed.stage["feet"]
    assert len(feet) == STEPS
    apart_m, solid_m, on_detail = [], [], 0
    for (x, z), foot in zip(walk, feet, strict=True):
        expected = ground.height_m(x, z)
        assert (foot is None) == (expected is None), (x, z)
        if foot is not None and expected is not None:
            apart_m.append(abs(foot[0] - expected[0]))
            solid_m.append(abs(foot[2] - foot[0]))
            on_detail += foot[1] >= 0
    assert 20 < on_detail < len(apart_m) - 20, "the walk is on detail, and on the base"
    assert max(apart_m) <= BOUND_M, max(apart_m)
    # Bodies stand on the same: what is made solid around the feet.
    assert max(solid_m) <= BOUND_M, max(solid_m)
