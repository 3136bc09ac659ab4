"""The blocking face of the SDK, against the real service."""

from __future__ import annotations

import _thread
import threading
import time

import pytest
from server.grid_scene import SIDE, TILE_M

import terraport
from terraport.errors import LandingTimeoutError, ServerError, SessionClosedError, UsageError
from terraport_server import BackgroundServer

CENTRE = (SIDE * TILE_M / 2, 1.0, SIDE * TILE_M / 2)
EVERYWHERE_M = 100.0


def threads() -> list[str]:
    return [t.name for t in threading.enumerate() if t.name == "terraport-sync"]


def test_it_does_what_the_asynchronous_one_does(server: BackgroundServer) -> None:
    with terraport.sync.connect(server.scene_url("grid")) as session:
        session.aim(CENTRE, radius_m=5.0)
        landing = session.land(CENTRE, radius_m=12.0)
        seen = [segment.id for segment in landing]
        assert sorted(seen) == [segment.id for segment in landing.ready()] == list(session.visible)
        assert landing.is_ready
        assert landing.missing == ()
        assert landing.stats.plans == landing.number == 1
        assert len(landing.presentable()) == len(landing.segments)
        assert session.hidden_faces.sum() == 2 * len(seen)
        assert len(session.visible_set_hash()) == 16
        assert session.pick((5.0, 50.0, 5.0)).segment == 0
        assert session.manifest()["id"] == session.scene.id == "grid"
        assert session.limits.max_radius_m == 500.0
        assert session.url.endswith("/scenes/grid")
        assert session.stats.connections == 1
        assert "Landing 1" in repr(landing)
        assert repr(session) == f"<Session {session.url}>"
    assert threads() == []


def test_errors_come_through_and_the_session_lives_on(server: BackgroundServer) -> None:
    with terraport.sync.connect(server.scene_url("big"), credit_bytes=20_000) as session:
        with pytest.raises(UsageError):
            session.land(CENTRE, radius_m=-1.0)
        with pytest.raises(ServerError, match="radius_too_large"):
            session.land(CENTRE, radius_m=501.0)
        landing = session.land(CENTRE, radius_m=EVERYWHERE_M)
        with pytest.raises(LandingTimeoutError):
            landing.ready(0.001)
        session.land(CENTRE, radius_m=1.0)
        with pytest.raises(terraport.LandingSuperseded):
            landing.ready()


def test_failing_to_open_leaves_no_thread(server: BackgroundServer) -> None:
    with pytest.raises(ServerError), terraport.sync.connect(server.scene_url("nowhere")):
        pass
    assert threads() == []


def test_a_session_without_a_block(server: BackgroundServer) -> None:
    session = terraport.sync.connect(server.scene_url("grid")).open()
    assert session.land(CENTRE, radius_m=5.0).ready(10)
    session.close()
    session.close()
    assert threads() == []


def test_outside_its_block_it_says_so(server: BackgroundServer) -> None:
    assert repr(terraport.sync.connect(server.url)) == "<Session, not open yet>"
    session = terraport.sync.connect(server.scene_url("grid"))
    with pytest.raises(SessionClosedError, match="not opened"):
        session.land(CENTRE)
    with session:
        landing = session.land(CENTRE, radius_m=5.0)
    session.close()
    with pytest.raises(SessionClosedError, match="closed here"):
        session.land(CENTRE)
    with pytest.raises(SessionClosedError, match="closed here"):
        landing.ready()


def test_ctrl_c_ends_the_call_and_leaves_nothing_behind(server: BackgroundServer) -> None:
    """Interrupted while it waits; the session is usable, and closes when its block is left."""

    def interrupt() -> None:
        time.sleep(0.2)
        _thread.interrupt_main()

    with terraport.sync.connect(server.scene_url("big"), credit_bytes=1) as session:
        landing = session.land(CENTRE, radius_m=EVERYWHERE_M)  # 10 MB, byte by byte: takes for ever
        interrupter = threading.Thread(target=interrupt)
        interrupter.start()
        with pytest.raises(KeyboardInterrupt):
            landing.ready()
        interrupter.join()
        assert session.pick((5.0, 50.0, 5.0)).segment == 0
    assert threads() == []
