"""What people painted on the ground of a scene: the contents of ``strokes.geojson``.

Format in ``spec/scene-format.md``, section "strokes.geojson". Files are read and written by
:mod:`~terraport_store.painting`.

PURE: no I/O, no clock.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Self

import xxhash

from terraport_store.errors import DamagedSceneError, StrokeError
from terraport_store.labels import label_fault
from terraport_store.layout import MAX_STROKES_BYTES, STROKES
from terraport_store.manifest import Manifest

__all__ = ["MAX_PLACES", "MAX_STROKES", "MAX_WIDTH_M", "Stroke", "Strokes"]

MAX_STROKES: Final = 2_000
"""Strokes of a scene: a forest learns no more from the next."""

MAX_PLACES: Final = 256
"""Places of one stroke."""

MIN_WIDTH_M: Final = 0.05
MAX_WIDTH_M: Final = 100.0

_MAX_REACH_M: Final = 1e7
"""As far from the origin as anything on the wire may be."""

_DIGITS: Final = 3
"""Of coordinates in the file: millimetres, or thousandths of a foot."""

_OPENING: Final = b', "features": [\n'
_BETWEEN: Final = b",\n"
_CLOSING: Final = b"\n]}\n"

_COLOUR: Final = re.compile(r"#[0-9a-f]{6}")
_ID: Final = re.compile(r"[0-9a-f]{16}")
_WHEN: Final = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ")


@dataclass(frozen=True, slots=True)
class Stroke:
    """One stroke of a brush."""

    id: str
    name: str
    colour: str
    width_m: float
    line: tuple[tuple[float, float], ...]
    """x and z of the scene frame, metres."""
    who: str
    """Name of the token that painted it."""
    when: str
    """UTC, ``2026-11-24T09:12:07Z``."""

    def __post_init__(self) -> None:
        """Refuse what the format does not allow.

        Raises
        ------
        StrokeError
            Saying what was received and what was expected.
        """
        fault = label_fault(self.name)
        if fault is not None:
            raise StrokeError(f"name: {fault}")
        for name, form, expected in (
            ("id", _ID, "16 hexadecimal digits"),
            ("colour", _COLOUR, "# and six hexadecimal digits"),
            ("when", _WHEN, "a time in UTC"),
        ):
            if not form.fullmatch(getattr(self, name)):
                raise StrokeError(f"{name} {getattr(self, name)[:64]!r}, expected {expected}")
        if not MIN_WIDTH_M <= self.width_m <= MAX_WIDTH_M:
            raise StrokeError(
                f"width_m {self.width_m:g}, expected {MIN_WIDTH_M:g} to {MAX_WIDTH_M:g}"
            )
        if not 2 <= len(self.line) <= MAX_PLACES:
            raise StrokeError(f"line of {len(self.line)} places, expected 2 to {MAX_PLACES}")
        if not all(abs(value) <= _MAX_REACH_M for place in self.line for value in place):
            raise StrokeError(f"line leaves the scene, expected places within {_MAX_REACH_M:g} m")

    @classmethod
    def painted(cls, body: object, *, stroke_id: str, who: str, when: str) -> Self:
        """Read what somebody sends to paint.

        Parameters
        ----------
        body : object
            ``{name, colour, width_m, line}``; other members are passed over.
        stroke_id, who, when : str
            What the receiver adds.

        Raises
        ------
        StrokeError
            It is something else.

        Examples
        --------
        >>> body = {"name": "road", "colour": "#c08a2e", "width_m": 3, "line": [[0, 1], [2, 3]]}
        >>> Stroke.painted(body, stroke_id="0" * 16, who="anna", when="2026-11-24T09:12:07Z").line
        ((0.0, 1.0), (2.0, 3.0))
        """
        if not isinstance(body, dict):
            raise StrokeError(f"a stroke is a {type(body).__name__}, expected an object")
        name, colour, line = (body.get(key) for key in ("name", "colour", "line"))
        width_m = _number(body.get("width_m"))
        if not isinstance(name, str) or not isinstance(colour, str) or width_m is None:
            raise StrokeError("a wrong name, colour or width_m, expected two texts and a number")
        # Counted before it is looked at.
        if not isinstance(line, list) or len(line) > MAX_PLACES:
            raise StrokeError(f"a wrong line, expected a list of 2 to {MAX_PLACES} places")
        return cls(stroke_id, name, colour.lower(), width_m, _places(line), who, when)

    def document(self) -> dict[str, Any]:
        """Return it as it is told over HTTP."""
        return {
            "id": self.id,
            "name": self.name,
            "colour": self.colour,
            "width_m": self.width_m,
            "line": [list(place) for place in self.line],
            "who": self.who,
            "when": self.when,
        }


@dataclass(frozen=True, slots=True)
class Strokes:
    """All of a scene, in the order in which they were painted, and what else is in the file."""

    strokes: tuple[Stroke, ...] = ()
    others: tuple[Mapping[str, Any], ...] = ()
    """Features that are no strokes: somebody drew them in a GIS."""
    revision: str = ""
    """XXH3-64 of the file; empty where there is none."""
    lines: Mapping[Stroke, bytes] = field(default_factory=dict, repr=False, compare=False)
    """The lines of the file that were read, by stroke: none is read or written anew that is known.
    """
    frame: tuple[float, float, float] | None = field(default=None, repr=False, compare=False)
    """Of these lines: easting and northing of the scene's origin, metres of a unit."""

    def with_one(self, stroke: Stroke) -> Strokes:
        """Add a stroke.

        Raises
        ------
        StrokeError
            There are as many as there may be.
        """
        if len(self.strokes) >= MAX_STROKES:
            raise StrokeError(
                f"{MAX_STROKES:,} strokes are there, expected fewer: take some back", is_full=True
            )
        return replace(self, strokes=(*self.strokes, stroke))

    def without(self, stroke_id: str) -> Strokes:
        """Leave a stroke out."""
        return replace(self, strokes=tuple(one for one in self.strokes if one.id != stroke_id))

    def encoded(self, manifest: Manifest) -> bytes:
        """Write strokes.geojson, in the coordinates of a scene's survey.

        Raises
        ------
        StrokeError
            The file would be larger than it may.
        """
        document: dict[str, Any] = {"type": "FeatureCollection"}
        if manifest.crs is not None and manifest.crs.epsg is not None:
            name = f"urn:ogc:def:crs:EPSG::{manifest.crs.epsg}"
            document["crs"] = {"type": "name", "properties": {"name": name}}
        east, north, unit_m = frame = _plan_frame(manifest)
        known = self.lines if self.frame == frame else {}
        lines: list[bytes] = []
        for stroke in self.strokes:
            line = known.get(stroke)
            if line is None:
                properties = stroke.document()
                coordinates = [
                    [round((east + x) / unit_m, _DIGITS), round((north - z) / unit_m, _DIGITS)]
                    for x, z in properties.pop("line")
                ]
                line = _line(
                    {
                        "type": "Feature",
                        "properties": properties,
                        "geometry": {"type": "LineString", "coordinates": coordinates},
                    }
                )
            lines.append(line)
        lines += map(_line, self.others)
        data = _line(document)[:-1] + _OPENING + _BETWEEN.join(lines) + _CLOSING
        if len(data) > MAX_STROKES_BYTES:
            raise StrokeError(
                f"{len(data):,} bytes of strokes, expected at most {MAX_STROKES_BYTES:,}",
                is_full=True,
            )
        return data

    @classmethod
    def parsed(cls, data: bytes, manifest: Manifest, before: Strokes | None = None) -> Self:
        """Read strokes.geojson; of a file that :meth:`encoded` wrote, line by line.

        Parameters
        ----------
        data : bytes
        manifest : Manifest
        before : Strokes, optional
            Of an earlier reading: lines that it has are not read anew.

        Raises
        ------
        DamagedSceneError
            It is no FeatureCollection, or larger than it may be.
        """
        if len(data) > MAX_STROKES_BYTES:
            raise _damaged(f"{len(data)} bytes, expected at most {MAX_STROKES_BYTES}")
        frame = _plan_frame(manifest)
        known: dict[bytes, Stroke] = {}
        if before is not None and before.frame == frame:
            known = {line: stroke for stroke, line in before.lines.items()}
        strokes: list[Stroke] = []
        others: list[Mapping[str, Any]] = []
        lines: dict[Stroke, bytes] = {}
        seen: set[str] = set()
        for line, feature in _features(data, known):
            stroke = known[line] if line in known else _stroke(feature, frame)
            if stroke is not None and stroke.id not in seen and len(strokes) < MAX_STROKES:
                seen.add(stroke.id)
                strokes.append(stroke)
                if line:
                    lines[stroke] = line
            else:
                others.append(json.loads(line) if feature is None else feature)
        revision = xxhash.xxh3_64_hexdigest(data)
        return cls(tuple(strokes), tuple(others), revision, lines, frame)


def _line(value: Mapping[str, Any]) -> bytes:
    return json.dumps(value, ensure_ascii=False).encode()


def _features(data: bytes, known: Container[bytes]) -> Iterator[tuple[bytes, Any]]:
    """Return each feature with its line of the file; of a known line, None in its place.

    One JSON text of 16 MB keeps the interpreter for a tenth of a second, whatever thread reads it;
    lines of a few kilobytes do not. Of a file in another form all lines are empty.

    Raises
    ------
    DamagedSceneError
        It is no FeatureCollection.
    """
    head, opening, rest = data.partition(_OPENING)
    if opening and rest.endswith(_CLOSING):
        lines = rest[: -len(_CLOSING)].split(_BETWEEN)
        try:
            # Of pieces that are each an object, the whole is a list of them and nothing else.
            is_ours = isinstance(json.loads(head + b"}"), dict)
            features = [None if line in known else json.loads(line) for line in lines if line]
        except (ValueError, RecursionError):
            is_ours = False
        if is_ours and all(feature is None or isinstance(feature, dict) for feature in features):
            yield from zip((line for line in lines if line), features, strict=True)
            return
    try:
        document = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise _damaged(f"does not parse as JSON: {error}") from None
    listed = document.get("features") if isinstance(document, dict) else None
    if not isinstance(listed, list):
        raise _damaged("no list of features, expected a FeatureCollection")
    yield from ((b"", feature) for feature in listed)


def _plan_frame(manifest: Manifest) -> tuple[float, float, float]:
    """Easting and northing of the scene's origin in metres, and metres of a unit of the file."""
    units = manifest.survey_units
    unit_m = units.horizontal_m if manifest.crs is None and units is not None else 1.0
    return manifest.origin[0], manifest.origin[1], unit_m


def _stroke(feature: Any, frame: tuple[float, float, float]) -> Stroke | None:
    """Read a feature; None of one that is no stroke."""
    east, north, unit_m = frame
    try:
        properties, geometry = feature["properties"], feature["geometry"]
        if geometry["type"] != "LineString":
            return None
        line = [[e * unit_m - east, north - n * unit_m] for e, n, *_ in geometry["coordinates"]]
        texts = [properties[key] for key in ("id", "who", "when")]
        if not all(isinstance(text, str) for text in texts):
            return None
        stroke_id, who, when = texts
        return Stroke.painted({**properties, "line": line}, stroke_id=stroke_id, who=who, when=when)
    except (StrokeError, TypeError, KeyError, ValueError):
        return None


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _places(line: list[Any]) -> tuple[tuple[float, float], ...]:
    places = []
    for place in line:
        pair = [_number(value) for value in place] if isinstance(place, list) else []
        if len(pair) != 2 or pair[0] is None or pair[1] is None:
            raise StrokeError("a wrong place in the line, expected two numbers, x and z")
        places.append((pair[0], pair[1]))
    return tuple(places)


def _damaged(what: str) -> DamagedSceneError:
    return DamagedSceneError(STROKES, what)
