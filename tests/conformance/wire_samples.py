"""One smallest and one fullest message of every type: the corpus and the codec tests start here."""

from __future__ import annotations

import dataclasses
from typing import Any

import terraport_wire as m
from terraport_wire import LOAD_DTYPE
from terraport_wire.kinds import Kind
from terraport_wire.message import Part, PartKind, PartList, fields_of, to_map
from terraport_wire.tables import HeldTable, Ids, LoadTable

_BUDGETS = m.Budgets(
    max_triangles=2_000_000, max_bytes=40_000_000, max_segments=500,
    max_gpu_bytes=268_435_456, gpu_vertex_bytes=28, gpu_face_bytes=12,
)  # fmt: skip
_SCENE = m.SceneInfo(id="quarry", version="00c0ffee1234", name="Steinbruch Süd 石", segment_count=9)
_LIMITS = m.ServerLimits(
    max_radius_m=500.0,
    max_message_bytes=1_048_576,
    max_messages_per_s=60.0,
    max_held_segments=32_768,
    max_plan_segments=16_384,
    max_credit_bytes=67_108_864,
    idle_timeout_s=60.0,
)
_ROWS = [
    (7, 1_000, 0x0123456789ABCDEF, 2_000, 1_100, (-1.5, 0.0, 2.25, 3.5, 4.0, 8.0)),
    (0, 1, 0, 0, 0, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    (4_294_967_295, 67_108_864, 2**64 - 1, 20_000, 10_000, (0.1, -1e7, 0.3, 0.5, 1e7, 0.7)),
]

MINIMAL: tuple[m.Message, ...] = (
    m.Hello(protocol=(1, 0), client="", encoding="segment-2", budgets=m.Budgets(), credit_bytes=0),
    m.Aim(generation=0, position=(0.0, 0.0, 0.0), radius_m=0.5),
    m.Land(generation=1, position=(0.0, 0.0, 0.0), radius_m=60.0),
    m.Credit(bytes=1),
    m.Evict(segments=[]),
    m.Reject(generation=0, segment=0, reason=""),
    m.Pick(request=0, origin=(0.0, 0.0, 0.0)),
    m.Bye(),
    m.Held(segments=[]),
    m.Join(request=0, group="a", role="member"),
    m.Leave(),
    m.Gather(request=0, position=(0.0, 0.0, 0.0), radius_m=60.0),
    m.Arrived(gathering=1, state="ready"),
    m.Welcome(
        protocol=(1, 0),
        server="",
        session="",
        scene=_SCENE,
        limits=_LIMITS,
        release_factor=1.0,
        dropped=[],
        held_count=0,
    ),
    m.Plan(
        generation=1,
        position=(0.0, 0.0, 0.0),
        radius_m=60.0,
        release_radius_m=75.0,
        effective_radius_m=60.0,
        inner_count=0,
        load=[],
        keep=[],
        nearby=[],
        load_bytes=0,
        load_triangles=0,
        total_bytes=0,
        total_triangles=0,
        omitted_segments=0,
    ),
    m.Prefetch(generation=0, segments=[], bytes=0),
    m.Ready(generation=0, delivered=0, payload_bytes=0, missing=[]),
    m.Degraded(generation=0, segments=[]),
    m.Superseded(generation=0, by=1, unsent_bytes=0),
    m.Picked(request=0),
    m.Notice(kind="draining"),
    m.Error(code="internal", message="", fatal=True),
    m.HeldChecked(dropped=[], held_count=0),
    m.Joined(request=0, group="a", member=1, role="guide", seat="s"),
    m.Roster(group="a", members=()),
    m.Gathering(gathering=1, guide=1, position=(0.0, 0.0, 0.0), radius_m=60.0),
    m.Gathered(gathering=1, ready=[], degraded=[], missing=[]),
)

FULL: tuple[m.Message, ...] = (
    m.Hello(
        protocol=(1, 3),
        client="terraport-python/0.1.0 (Größe ✓ 𝄞)",
        token="eyJhbGciOiJIUzI1NiJ9.e30.abc-_",
        encoding="segment-2",
        budgets=_BUDGETS,
        credit_bytes=8_388_608,
        release_factor=1.25,
        scene_version="00c0ffee1234",
        held=[(0, 0), (3, 0x0123456789ABCDEF), (4_294_967_295, 2**64 - 1)],
        delivery="pull",
        timings=True,
    ),
    m.Aim(generation=4_294_967_295, position=(1e7, -1e7, 0.1), radius_m=1e6, coarse_radius_m=1e6),
    m.Land(
        generation=77,
        position=(12.5, -3.0, 1e-300),
        radius_m=60.0,
        inner_radius_m=20.0,
        deadline_ms=1500,
        stall_ms=400,
        coarse_radius_m=180.0,
    ),
    m.Credit(bytes=9_007_199_254_740_991),
    m.Evict(segments=[5, 1, 4_294_967_295, 0]),
    m.Reject(generation=4_294_967_295, segment=4_294_967_295, reason="hash_mismatch"),
    m.Pick(request=4_294_967_295, origin=(1.0, 2.0, 3.0), direction=(0.0, -1e7, 0.5)),
    m.Bye(),
    m.Held(segments=[(0, 0), (3, 0x0123456789ABCDEF), (4_294_967_295, 2**64 - 1)]),
    m.Join(
        request=4_294_967_295,
        group="Tour-2.a~b_",
        role="guide",
        name="Größe ✓ 𝄞",
        seat="q9XwT0bW3mZk5cV7nR1uYg",
    ),
    m.Leave(),
    m.Gather(
        request=7,
        position=(12.5, -3.0, 1e-300),
        radius_m=60.0,
        inner_radius_m=20.0,
        deadline_ms=30_000,
    ),
    m.Arrived(gathering=4_294_967_295, state="degraded"),
    m.Welcome(
        protocol=(1, 0),
        server="terraport/0.1.0",
        session="9f3a",
        scene=dataclasses.replace(_SCENE, levels=2),
        limits=dataclasses.replace(_LIMITS, groups="query"),
        release_factor=1.25,
        dropped=[3, 1],
        held_count=2,
        pull=m.PullInfo(
            base="https://cdn.example/scenes/north%20pit/",
            pack="v-2c677e39487f/segments.pack",
            pack_bytes=274_877_906_944,
        ),
    ),
    m.Plan(
        generation=77,
        position=(12.5, -3.0, 1e-300),
        radius_m=60.0,
        release_radius_m=75.0,
        effective_radius_m=41.25,
        inner_count=2,
        load=_ROWS,
        keep=[1, 2],
        nearby=[3, 4, 5],
        load_bytes=67_109_865,
        load_triangles=22_000,
        total_bytes=67_200_000,
        total_triangles=30_000,
        omitted_segments=12,
        omitted_by="max_triangles",
        total_gpu_bytes=201_000_000,
        blocks=[4_294_967_295, 1, 1_048_577],
    ),
    m.Prefetch(generation=78, segments=_ROWS[:2], bytes=1_001, blocks=[16, 1]),
    m.Ready(
        generation=77,
        delivered=2,
        payload_bytes=1_001,
        missing=[4_294_967_295],
        timings=m.Timings(
            plan_us=310,
            first_byte_us=402,
            last_byte_us=98_765,
            ready_us=98_770,
            credit_wait_us=12_000,
        ),
    ),
    m.Degraded(generation=77, segments=[7, 1]),
    m.Superseded(generation=77, by=79, unsent_bytes=67_108_864),
    m.Picked(
        request=5,
        hit=m.Hit(
            position=(1.0, 2.5, 3.0),
            normal=(0.0, 1.0, 0.0),
            segment=7,
            region=3,
            stable_id=4_294_967_295,
            label="haul road",
            height_m=412.5,
            attributes={"grade": 1.25, "_NAME 2": -0.0},
        ),
    ),
    m.Notice(kind="scene_published", version="beef", reconnect_after_ms=250),
    m.Error(
        code="unsupported_version",
        message="got protocol 3.0, expected one of 1.0, 2.4",
        fatal=True,
        generation=3,
        request=4,
        protocols=((1, 0), (2, 4)),
    ),
    m.HeldChecked(dropped=[3, 1], held_count=4_294_967_295),
    m.Joined(
        request=4_294_967_295,
        group="Tour-2.a~b_",
        member=3,
        role="member",
        seat="q9XwT0bW3mZk5cV7nR1uYg",
    ),
    m.Roster(
        group="Tour-2.a~b_",
        members=(
            m.Member(member=1, name="Größe ✓ 𝄞", role="guide", present=True),
            m.Member(member=3, role="member", present=False, position=(12.5, -3.0, 1e-300)),
        ),
    ),
    m.Gathering(
        gathering=4_294_967_295,
        guide=1,
        position=(12.5, -3.0, 1e-300),
        radius_m=60.0,
        inner_radius_m=20.0,
        left_ms=29_000,
    ),
    m.Gathered(gathering=2, ready=[1, 4], degraded=[3], missing=[2, 4_294_967_295]),
)


def by_type(messages: tuple[m.Message, ...]) -> dict[str, m.Message]:
    """Return the messages by their type."""
    return {message.TYPE: message for message in messages}


def plain(message: m.Message) -> dict[str, Any]:
    """Return the map that msgpack gets for a message, `type` first."""
    return {"type": message.TYPE, **to_map(message)}


def readable(message: m.Message) -> dict[str, Any]:
    """Return a message as the corpus states it: tables as lists of rows, hashes as text."""
    return {"type": message.TYPE, **_readable_part(message)}


def readable_value(kind: Kind, value: Any) -> Any:
    """Return one field's value as the corpus states it."""
    match kind:
        case PartKind():
            return _readable_part(value)
        case PartList():
            return [_readable_part(item) for item in value]
        case Ids():
            return value.tolist()
        case HeldTable():
            return [[int(row["id"]), f"{row['xxh3']:016x}"] for row in value]
        case LoadTable():
            return [
                {
                    name: f"{row[name]:016x}" if name == "xxh3" else row[name].tolist()
                    for name in LOAD_DTYPE.names or ()
                }
                for row in value
            ]
    return kind.to_wire(value)


def _readable_part(wire_part: Part) -> dict[str, Any]:
    values = {
        field.name: (field.kind, getattr(wire_part, field.name))
        for field in fields_of(type(wire_part))
    }
    return {
        name: readable_value(kind, value)
        for name, (kind, value) in values.items()
        if value is not None
    }
