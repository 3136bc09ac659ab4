"""The sender on uvicorn's own protocol: no connection to reach, and everything works."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient, assemble

from terraport_server import BackgroundServer, serving
from terraport_wire import Evict, Land, Plan, Ready


def test_landings_without_the_extension(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grid = write_grid_scene(tmp_path / "pit", cells=60, compress=False)
    monkeypatch.setattr(serving, "protocol_class", lambda *_, **__: "websockets-sansio")
    with (
        BackgroundServer(tmp_path) as server,
        PlainClient(server.scene_url("pit")) as client,
    ):
        client.hello()
        for generation in (1, 2):
            client.send(Evict(segments=np.arange(36, dtype=np.uint32)))
            client.send(Land(generation=generation, position=(30.0, 0.0, 30.0), radius_m=5.0))
            plan = client.expect(Plan)
            _, frames, _ = client.until(Ready)
            assert len(frames) > len(plan.load)
            assert assemble(frames) == {s: grid.payloads[s] for s in plan.load["id"].tolist()}
