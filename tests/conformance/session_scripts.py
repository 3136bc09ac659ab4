"""The scripts of the session corpus: what chance makes, and what somebody thought of."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from random import Random
from typing import Any, Final

from conformance.session_play import Operation, Script

from terraport_wire import PayloadFrame, Superseded, encode, encode_frame

__all__ = ["NAMED", "THEMES", "make_script", "named_scripts"]

Make = Callable[[Random], Operation]


def _place(chance: Random) -> list[int]:
    """Few places: what happens at one meets what happened there before."""
    return [chance.choice((0, 2, 10)), 0, chance.choice((0, 1))]


def _land(chance: Random) -> Operation:
    return ("call", "land", _place(chance), chance.choice((0.5, 1.5, 2.5, 3.5)), None, None)


def _urgent_land(chance: Random) -> Operation:
    return ("call", "land", _place(chance), chance.choice((2.5, 3.5)), 1.5, 100)


def _far_land(chance: Random) -> Operation:
    return ("call", "land", _place(chance), 9.5, None, None)


def _aim(chance: Random) -> Operation:
    return ("call", "aim", _place(chance), chance.choice((0.5, 1.5, 2.5)))


def _far_aim(chance: Random) -> Operation:
    return ("call", "aim", _place(chance), 9.5)


def _pick(chance: Random) -> Operation:
    return ("call", "pick", [1, 2, 3], chance.choice((None, [0, -1, 0])))


def _join(chance: Random) -> Operation:
    group = chance.choice(("tour", "tour", "tour", "walk"))
    name = chance.choice((None, "Bo"))
    return ("call", "join", group, chance.choice(("guide", "member", "member")), name)


def _gather(chance: Random) -> Operation:
    bounds = chance.choice(((None, None), (None, 500), (1.5, None)))
    return ("call", "gather", _place(chance), chance.choice((1.5, 2.5, 2.5, 9.5)), *bounds)


def _arrive(chance: Random) -> Operation:
    state = chance.choice(("ready", "ready", "degraded", "declined"))
    return ("call", "arrived", chance.choice((1, 1, 2, 3)), state)


def _other(chance: Random) -> Operation:
    did: tuple[tuple[Any, ...], ...] = (
        ("join", chance.choice(("guide", "guide", "member"))),
        ("gather", _place(chance), chance.choice((1.5, 2.5)), chance.choice((None, 0.5))),
        ("gather", _place(chance), 2.5, None),
        ("arrived", chance.choice((1, 1, 2, 3)), chance.choice(("ready", "ready", "declined"))),
        ("leave",),
    )
    return ("other", *chance.choice(did))


def _impossible_group(chance: Random) -> Operation:
    given: tuple[tuple[Any, ...], ...] = (
        ("join", "a tour", "member", None),
        ("gather", [0, "nan", 0], 1, None, None),
        ("gather", [0, 0, 0], 0, None, None),
        ("gather", [0, 0, 0], 1, 2, None),
        ("gather", [0, 0, 0], 1, None, 0),
        ("arrived", 0, "ready"),
    )
    return ("call", *chance.choice(given))


def _ring(chance: Random) -> Operation:
    inner = chance.choice(((None, None), (None, None), (1.5, 100)))
    radius_m = chance.choice((1.5, 2.5))
    # 9 is what the server allows.
    ring_m = chance.choice((radius_m, 3.5, 3.5, 7.5, 20))
    return ("call", "land", _place(chance), radius_m, *inner, ring_m)


def _ring_aim(chance: Random) -> Operation:
    return ("call", "aim", _place(chance), chance.choice((0.5, 1.5)), chance.choice((2.5, 20)))


def _impossible_ring(chance: Random) -> Operation:
    given: tuple[tuple[Any, ...], ...] = (
        ("land", [0, 0, 0], 2, None, None, 1.5),
        ("land", [0, 0, 0], 2, None, None, 2e6),
        ("aim", [0, 0, 0], 2, 1.5),
        ("aim", [0, 0, 0], 2, "nan"),
    )
    return ("call", *chance.choice(given))


def _impossible(chance: Random) -> Operation:
    bad = chance.choice((0, -1, "nan", "inf"))
    nowhere = [0, chance.choice(("nan", "inf", "-inf")), 0]
    given: tuple[tuple[Any, ...], ...] = (
        ("land", [0, 0, 0], bad, None, None),
        ("land", nowhere, 1, None, None),
        ("land", [0, 0, 0], 1, 2, None),
        ("land", [0, 0, 0], 1, None, 5),
        ("aim", [0, 0, 0], bad),
        ("aim", nowhere, 1),
        ("pick", nowhere, None),
        ("pick", [0, 0, 0], [0, 0, 0]),
    )
    return ("call", *chance.choice(given))


def _stray(chance: Random) -> Operation:
    generation = chance.randrange(1, 5)
    chunk = memoryview(bytes(3))
    frame = PayloadFrame(generation, chance.randrange(36), chance.choice((0, 1)), 9, chunk)
    superseded = Superseded(generation=generation, by=generation + 1, unsent_bytes=0)
    strays = (
        b"\x81\xa4type\xa3new",
        b"\x05\x01\x02\x03",  # a frame of a later kind
        b"",
        b"\xc1",
        encode_frame(frame),
        encode(superseded),
    )
    return ("stray", base64.b64encode(chance.choice(strays)).decode())


def _made(name: str, *choices: Sequence[Any]) -> Make:
    return lambda chance: (name, *(chance.choice(values) for values in choices))


OPERATIONS: Final[dict[str, Make]] = {
    "land": _land,
    "urgent": _urgent_land,
    "far": _far_land,
    "aim": _aim,
    "far aim": _far_aim,
    "flush": lambda _: ("call", "flush"),
    "pick": _pick,
    "impossible": _impossible,
    "bye": lambda _: ("call", "bye"),
    "pump": _made("pump", (1, 2, 3, 5, 8, 13, 40)),
    "serve": _made("serve", (1, 2, 5)),
    "hear": _made("hear", (1, 2, 5)),
    "take": lambda _: ("take",),
    "lag": _made("lag", (0, 1, 4, 20)),
    "cut": lambda _: ("cut",),
    "connect": _made("connect", (True, True, False), (0,)),
    "newer": _made("connect", (True, False), (1,)),
    "flip": _made("flip", (1, 2, 3)),
    "fail": _made("fail", range(36)),
    "wait": _made("wait", (0.2,)),
    "publish": lambda _: ("publish",),
    "drain": lambda _: ("drain",),
    "stray": _stray,
    "text": lambda _: ("text", "{}"),
    "again": _made("again", range(1, 9)),
    "join": _join,
    "leave": lambda _: ("call", "leave"),
    "gather": _gather,
    "arrive": _arrive,
    "other": _other,
    "no-such-group": _impossible_group,
    "ring": _ring,
    "ring-aim": _ring_aim,
    "no-such-ring": _impossible_ring,
    "flat": _made("connect", (True, False), (2,)),
    "fail-coarse": _made("fail", range(36, 72)),
    "long": _made("wait", (0.3, 1.1, 2.1)),
}

MOVES: Final = "land land pump pump pump serve hear take lag"

THEMES: Final[dict[str, str]] = {
    "landings": f"{MOVES} far impossible bye",
    "aims": f"{MOVES} aim aim flush flush flush far connect",
    "cuts": f"{MOVES} cut connect connect aim flush aim flush pick",
    "flips": f"{MOVES} flip flip flip aim flush connect",
    "deadlines": f"{MOVES} urgent urgent urgent wait wait flip fail",
    "versions": f"{MOVES} newer connect aim flush publish drain",
    "missing": f"{MOVES} fail fail fail flip aim flush",
    "picks": f"{MOVES} pick pick pick connect impossible cut",
    "refusals": f"{MOVES} far far aim flush connect impossible far",
    "strays": f"{MOVES} stray stray again again connect aim flush text",
    "levels": (
        f"{MOVES} ring ring ring ring ring-aim flush no-such-ring cut connect newer flat flip "
        "fail-coarse wait again"
    ),
    "groups": (
        "land pump pump pump serve hear take lag join join leave gather gather arrive arrive "
        "other other other cut connect connect long long no-such-group pick again"
    ),
}
"""What may happen in each, as often as it is named."""


_HERE: Final = ("call", "land", [0, 0, 0], 2.5, None, None)
_THERE: Final = ("call", "land", [10, 0, 0], 2.5, None, None)
_INNER: Final = ("call", "land", [2, 0, 0], 2.5, 1.5, 100)
_AIM: Final = (("pump", 4), ("call", "aim", [0, 0, 0], 2.5), ("call", "flush"))
_AGAIN: Final = (("cut",), ("connect", True, 0))
_AWAY: Final = (("take",), ("serve", 40))

NAMED: Final[dict[str, tuple[Operation, ...]]] = {
    "an aim of which all came is not sent again": (*_AIM, ("pump", 40), *_AGAIN),
    "an aim that a cut ended is sent again": (*_AIM, ("pump", 5), *_AGAIN),
    "nothing is let go while a landing has no plan":
        (_HERE, ("pump", 40), _THERE, *_AWAY, _HERE, ("take",), ("hear", 40)),
    "an aim's segments wait for the plan that may keep them":
        (_THERE, ("pump", 40), *_AIM, *_AWAY, _HERE, ("take",), ("hear", 40)),
    "a reject crosses the next landing":
        (_HERE, ("flip", 1), *_AWAY, _HERE, ("take",), ("hear", 40)),
    "a reject crosses a landing elsewhere":
        (_HERE, ("flip", 1), *_AWAY, _THERE, ("take",), ("hear", 40)),
    "an inner set that came wrong":
        (("pump", 3), _INNER, ("take",), ("flip", 1), ("serve", 9), ("wait", 0.2), ("serve", 9)),
    "a hop back finds what was kept nearby":
        (("call", "land", [0, 0, 0], 3.5, None, None), ("pump", 40), _HERE, ("pump", 40),
         ("call", "land", [0, 0, 0], 3.5, None, None)),
    "half a segment goes on in the next plan":
        (_HERE, ("pump", 6), ("call", "land", [2, 0, 0], 2.5, None, None)),
    "a newer version": (_HERE, ("pump", 40), ("cut",), ("connect", True, 1), ("pump", 5), _HERE),
    "only the newest landing waits": (("pump", 5), _HERE, _THERE, _INNER),
    "a pick outlives a cut": (("call", "pick", [1, 2, 3], None), ("take",), *_AGAIN),
}  # fmt: skip
"""What chance seldom makes, by name; each with a cache of nothing and with one of everything."""


_JOIN: Final = ("call", "join", "tour", "member", "Bo")
_GUIDE: Final = (("other", "join", "guide"), ("pump", 3), _JOIN, ("pump", 5))
_CALLED: Final = (*_GUIDE, ("other", "gather", [0, 0, 0], 2.5, None), ("pump", 5))
_LEAD: Final = (("call", "join", "tour", "guide", None), ("pump", 5))
_LATER: Final = (("wait", 0.3), ("pump", 5))

NAMED_GROUPS: Final[dict[str, tuple[Operation, ...]]] = {
    "a seat is taken again by its secret": (*_GUIDE, *_AGAIN, ("pump", 5), *_LATER),
    "a seat that was forgotten meanwhile is a new one":
        (*_CALLED, ("call", "arrived", 1, "ready"), ("pump", 3), ("other", "leave"), ("cut",),
         ("wait", 1.2), ("other", "join", "guide"), ("connect", True, 0), ("pump", 5),
         ("other", "gather", [2, 0, 0], 2.5, None), ("pump", 5), ("call", "arrived", 1, "ready")),
    "who has arrived says so again where a cut swallowed it":
        (*_CALLED, ("call", "arrived", 1, "ready"), *_AGAIN, ("pump", 8),
         ("other", "arrived", 1, "ready"), ("pump", 5)),
    "nothing is said again of a barrier that is open":
        (*_CALLED, ("call", "arrived", 1, "ready"), ("other", "arrived", 1, "ready"), ("pump", 5),
         *_AGAIN, ("pump", 8)),
    "a newer gathering ends what was said of the older":
        (*_CALLED, ("call", "arrived", 1, "degraded"), ("other", "gather", [2, 0, 0], 2.5, None),
         ("pump", 5), ("call", "arrived", 1, "ready"), *_AGAIN, ("pump", 8)),
    "what crosses a leave is skipped":
        (*_GUIDE, ("other", "gather", [0, 0, 0], 2.5, None), ("serve", 3), ("call", "leave"),
         ("hear", 9), ("pump", 5)),
    "what crosses a join elsewhere is skipped":
        (*_GUIDE, ("other", "gather", [0, 0, 0], 2.5, None), ("serve", 3),
         ("call", "join", "walk", "guide", None), ("hear", 9), ("pump", 9)),
    "a gather waits for the seat":
        (*_LEAD, ("cut",), ("call", "gather", [0, 0, 0], 2.5, None, 900), ("connect", True, 0),
         ("pump", 9), ("call", "arrived", 1, "ready"), ("pump", 5)),
    "more gathers than may wait":
        (*_LEAD, ("cut",), *[("call", "gather", [0, 0, 0], 2.5, None, None)] * 17,
         ("connect", True, 0), ("pump", 40)),
    "two guides": (("other", "join", "guide"), *_LEAD, *_AGAIN, ("pump", 5)),
    "a gather that only the guide may": (*_GUIDE, ("call", "gather", [0, 0, 0], 2.5, None, None),
        ("pump", 5), ("call", "gather", [0, 0, 0], 9.5, None, None), ("pump", 5)),
    "where everybody stands":
        (*_GUIDE, *_LATER, ("other", "landed", (-2.25, 0.5, 1e4)), _HERE, ("wait", 1.1),
         ("pump", 40), *_AGAIN, ("pump", 8), *_LATER),
    "a landing of the group with a landing of its own":
        (*_CALLED, _HERE, ("pump", 40), ("call", "arrived", 1, "ready"), ("pump", 5),
         ("other", "arrived", 1, "declined"), ("pump", 5)),
}  # fmt: skip
"""Of groups, by name."""


_RING: Final = ("call", "land", [0, 0, 0], 1.5, None, None, 4.5)
_RING_THERE: Final = ("call", "land", [10, 0, 0], 1.5, None, None, 4.5)
_RING_AIM: Final = (("pump", 4), ("call", "aim", [0, 0, 0], 1.5, 20), ("call", "flush"))

NAMED_LEVELS: Final[dict[str, tuple[Operation, ...]]] = {
    "a hop exchanges levels, and back":
        (_RING, ("pump", 40), _RING_THERE, ("pump", 40), _RING, ("pump", 40)),
    "a ring comes, and goes":
        (_HERE, ("pump", 40), _RING, ("pump", 40), ("call", "land", [0, 0, 0], 1.5, None, None)),
    "a ring is cut to what the server allows":
        (("pump", 3), ("call", "land", [0, 0, 0], 1.5, None, None, 20), ("pump", 40), *_RING_AIM),
    "a ring that waits is cut once that is known":
        (("call", "land", [0, 0, 0], 1.5, None, None, 20), *_RING_AIM, ("cut",), ("pump", 3),
         ("connect", True, 0)),
    "a landing with a ring outlives a cut": (_RING, ("pump", 6), *_AGAIN),
    "an aim with a ring outlives a cut": (*_RING_AIM, ("pump", 5), *_AGAIN),
    "an aim brings the ring of the landing":
        (*_RING_AIM, ("pump", 60), ("call", "land", [0, 0, 0], 1.5, None, None, 9)),
    "a ring within the radius is refused":
        (("call", "land", [0, 0, 0], 2.5, None, None, 2), ("call", "aim", [0, 0, 0], 2.5, 2)),
    "half a coarser payload goes on in the next plan":
        (_RING, ("pump", 14), ("call", "land", [2, 0, 0], 1.5, None, None, 4.5)),
    "a coarser payload that came wrong":
        (_RING, ("take",), ("serve", 6), ("flip", 3), ("pump", 40)),
    "an inner set without its ring":
        (("pump", 3), ("call", "land", [0, 0, 0], 1.5, 1.5, 100, 4.5), ("take",), ("serve", 6),
         ("wait", 0.2), ("serve", 9)),
    "a newer version has one level":
        (_RING, ("pump", 40), ("cut",), ("connect", True, 2), ("pump", 5), _RING, ("pump", 40)),
}  # fmt: skip
"""Of levels, by name."""


def named_scripts() -> Iterator[tuple[str, Script]]:
    """Return what somebody thought of."""
    for names, levels, bounds in (
        (NAMED, 1, ((0, 50), (0, 10_000), (10_000, 50))),
        (NAMED_GROUPS, 1, ((0, 50),)),
        (NAMED_LEVELS, 2, ((10_000, 50),)),
    ):
        for (name, operations), (cache_bytes, credit_bytes) in product(names.items(), bounds):
            options = {
                "cache_bytes": cache_bytes,
                "credit_bytes": credit_bytes,
                "release_factor": 1.5,
                "max_bytes": None,
                "max_triangles": None,
                "max_segments": None,
            }
            script = Script(
                options, {"max_held_segments": 1000}, (("connect", True, 0), *operations), levels
            )
            yield f"{name}, {cache_bytes} {credit_bytes}", script


def make_script(theme: str, seed: int) -> Script:
    """Return one script of a theme."""
    chance = Random(f"{theme} {seed}")
    options: dict[str, Any] = {
        "cache_bytes": chance.choice((0, 0, 100, 300, 10_000)),
        "credit_bytes": chance.choice((1, 20, 50, 50, 200, 10_000)),
        "release_factor": chance.choice((None, 1.0, 1.5)),
        "max_bytes": chance.choice((None, None, None, 150)),
        "max_triangles": chance.choice((None, None, None, 40)),
        "max_segments": chance.choice((None, None, None, 5)),
    }
    limits = {
        "max_held_segments": chance.choice((0, 1, 5, 1000, 1000)),
        "max_credit_bytes": chance.choice((30, 1 << 20)),
    }
    if theme == "groups":
        limits["groups"] = chance.choice(("here", "here", "here", "query", "none"))
    words = THEMES[theme].split()
    count = chance.randrange(4, 24)
    moves = (OPERATIONS[chance.choice(words)](chance) for _ in range(count))
    levels = 2 if theme == "levels" else 1
    return Script(options, limits, (("connect", True, 0), *moves), levels)
