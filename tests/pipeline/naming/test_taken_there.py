"""From a plan to "take me there": by the command line and by the SDK, through a real service."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run_terraport
from pipeline.naming.named_ground import square, write_geojson

import terraport.sync
from terraport_pipeline.naming.plan import label_by_plan
from terraport_pipeline.progress import NullProgress
from terraport_server import BackgroundServer


def test_a_named_region_is_landed_on_where_it_is_seen_best(scene: Path, tmp_path: Path) -> None:
    plan = write_geojson(tmp_path / "p.geojson", [("stockpile", square(30, -50, 45, -35))])
    label_by_plan(scene, plan, NullProgress())
    with BackgroundServer(scene.parent) as server:
        url = f"{server.url}/scenes/pit"
        with terraport.sync.connect(url) as session:
            (place,) = session.places()
            assert place.label == "stockpile"
            assert place.is_view
            landing = session.land(place.position, place.radius_m)
            landing.ready()
            # It stands on the ground, beside or on it, and looks at it.
            hit = session.pick(place.position)
            assert hit is not None
            assert abs(hit.position[1] - place.position[1]) < 0.01
            towards = np.array([37.5, 42.5]) - np.array(place.position)[[0, 2]]
            heading = np.degrees(np.arctan2(towards[0], -towards[1])) % 360
            apart = abs((heading - place.heading_deg + 180) % 360 - 180)
            assert apart < 30 or np.hypot(*towards) < 8
        done = run_terraport("land", url, "--region", "Stockpile", "--json")
        assert done.returncode == 0, done.stderr
        facts = json.loads(done.stdout)
        assert facts["position"] == pytest.approx(place.position)
        assert facts["landings"][0]["radius_m"] == place.radius_m
        assert facts["region"]["label"] == "stockpile"
        for wrong, said in (
            (("--region", "lake"), "no region is called 'lake'"),
            (("1", "2", "3", "--region", "stockpile"), "expected one of them"),
        ):
            refused = run_terraport("land", url, *wrong)
            assert refused.returncode == 2
            assert said in refused.stderr
