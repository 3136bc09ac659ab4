"""What became of prefetched bytes, by itself and in a session."""

from __future__ import annotations

from server.session_model import Client, aim, ids, land, make_scene

from terraport_server.session.interface import Observer, SessionLimits
from terraport_server.session.session import Session
from terraport_wire import MAX_CHUNK_BYTES, Evict, Reject


class Ear(Observer):
    """Keeps what it hears of aims."""

    def __init__(self) -> None:
        self.ended: list[tuple[int, int]] = []
        self.judged: list[bool] = []

    def aim_ended(self, sent_bytes: int, used_bytes: int) -> None:
        self.ended.append((sent_bytes, used_bytes))

    def aim_judged(self, *, hit: bool) -> None:
        self.judged.append(hit)


def listened(**limits: object) -> tuple[Client, Ear]:
    scene, ear = make_scene(12, **limits), Ear()  # type: ignore[arg-type]
    session = Session(scene, SessionLimits(), session_id="s", now_s=0.0, observer=ear)
    client = Client(session, scene)
    client.greet()
    return client, ear


def test_a_hit() -> None:
    client, ear = listened()
    client.tell(aim(1))
    client.run()
    client.tell(land(2))
    client.run()
    client.tell(land(3))
    client.run()
    assert (ear.ended, ear.judged) == ([(3003, 3003)], [True])


def test_a_landing_elsewhere_wastes_and_is_a_miss() -> None:
    client, ear = listened()
    client.tell(aim(1))
    client.run()
    client.tell(land(2, 100.0))
    client.run()
    assert (ear.ended, ear.judged) == ([(3003, 0)], [False])


def test_a_part_that_the_landing_continues_is_used_and_one_that_is_forgotten_is_not() -> None:
    client, ear = listened(length=300_000)
    client.tell(aim(1, radius_m=5.0))
    client.run(most=2)
    client.tell(land(2, radius_m=5.0))
    client.run()
    assert (ear.ended, ear.judged) == ([(MAX_CHUNK_BYTES, MAX_CHUNK_BYTES)], [False])
    client.tell(aim(3, 100.0, radius_m=5.0))
    client.run(until=lambda: client.chunks[-1].generation == 3)
    client.tell(aim(4, 50.0, radius_m=5.0))
    client.run(most=2)
    assert ear.ended[1:] == [(MAX_CHUNK_BYTES, 0)]


def test_evicted_rejected_and_left_segments_are_waste() -> None:
    client, ear = listened()
    client.tell(aim(1))
    client.run()
    client.tell(Evict(segments=ids(0, 7)))
    client.held.discard(1)
    client.tell(Reject(generation=1, segment=1, reason="hash_mismatch"))
    assert ear.ended == [(1000, 0), (1001, 0)]
    client.run()
    client.session.ended()
    assert ear.ended[2:] == [(1001 + 1002, 0)], "segment 1 came again"
    assert sum(sent for sent, _ in ear.ended) == sum(chunk.length for chunk in client.chunks)
