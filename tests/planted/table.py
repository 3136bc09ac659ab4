"""Faults that somebody could make, one line each: what a test of this project must notice.

Texts are short, operators and constants rather than names, so that a rename seldom touches them;
``test_table.py`` notices when one does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

__all__ = ["FAULTS", "Fault"]

WIRE: Final = "wire/terraport_wire"
STORE: Final = "store/terraport_store"
PAYLOAD: Final = "payload/terraport_payload"
SERVER: Final = "server/terraport_server"
PIPELINE: Final = "pipeline/terraport_pipeline"
SDK: Final = "client_sdk/python/terraport"
WEB: Final = "client_sdk/web/src"
CSHARP: Final = "client_sdk/unity"
CPP: Final = "client_sdk/unreal/Source/TerraportCore/Private"


@dataclass(frozen=True, slots=True)
class Fault:
    """One edit of one file."""

    name: str
    path: str
    old: str
    """Occurs exactly once in the file."""
    new: str
    what: str


FAULTS: Final = (
    # -- wire
    Fault("frame-kind", f"{WIRE}/frames.py", "view[0] >= 0x80", "view[0] > 0x80",
          "boundary: a message's first byte is taken for a frame kind"),
    Fault("frame-end", f"{WIRE}/frames.py", "if offset + len(chunk) > total",
          "if offset + len(chunk) >= total + 2", "off by one: a chunk may run a byte past the end"),
    Fault("message-depth", f"{WIRE}/guard.py", "> MAX_DEPTH", "> MAX_DEPTH + 1",
          "a bound that is one too far"),
    Fault("token-padding", f"{WIRE}/codec.py", '"=" * (-len(text) % 4)', '"=" * (len(text) % 4)',
          "a sign: tokens of some lengths are lost"),
    # -- payload
    Fault("widest-segment", f"{PAYLOAD}/grid.py", "> (MAX_CODE - 1) * step", "> (MAX_CODE + 9) * step",
          "a code beyond 16 bits at the widest segment"),
    Fault("attribute-step", f"{PAYLOAD}/grid.py", "- scale.offset) / scale.step",
          "- scale.offset) * scale.step", "wrong unit: attributes are multiplied, not divided"),
    Fault("short-index", f"{PAYLOAD}/glb_encode.py", "len(order) <= _SHORT_INDEX_VERTICES",
          "len(order) <= _SHORT_INDEX_VERTICES + 2", "boundary: 16-bit indices for 65,536 vertices"),
    Fault("normals-below", f"{PAYLOAD}/normals.py", "plane[:, 2:] < 0.0", "plane[:, 2:] > 0.0",
          "a comparison the wrong way round: normals of the lower half"),
    Fault("image-bytes", f"{PAYLOAD}/glb_decode.py", "if length > MAX_IMAGE_BYTES", "if length < 0",
          "a missing bound on hostile bytes"),
    # -- store
    Fault("radius-boundary", f"{STORE}/packed_rtree.py", "point) <= radius_m", "point) < radius_m",
          "boundary: a segment at exactly the radius"),
    Fault("rtree-last-leaf", f"{STORE}/packed_rtree.py", "np.uint32) // size",
          "np.uint32) // (size + 1)", "silent truncation: leaves hold more than their box says"),
    Fault("label-twice", f"{STORE}/labels.py", "if number <= before", "if number < before",
          "boundary: the same stable id twice"),
    Fault("payload-overlap", f"{STORE}/index.py", "self.offset[1:] < end[:-1]",
          "self.offset[1:] < end[:-1] - 1", "off by one: payloads that overlap by a byte"),
    Fault("region-range", f"{STORE}/validate.py", "index.region >= counts.regions",
          "index.region > counts.regions", "boundary: a region that does not exist is called valid"),
    Fault("range-end", f"{STORE}/source.py", "offset + length > size", "offset > size",
          "a read past the end comes back short instead of failing"),
    Fault("lock-kept", f"{STORE}/labelling.py", "lock.release()", "pass",
          "forgotten release: the second change of labels finds the scene busy"),
    # -- service
    Fault("landing-boundary", f"{SERVER}/selection.py", "distances <= radius_m",
          "distances < radius_m", "boundary: what touches the radius is left out"),
    Fault("generation-twice", f"{SERVER}/session.py", "generation <= newest", "generation < newest",
          "order: a generation may be used twice"),
    Fault("deadline", f"{SERVER}/transfer.py", "now_s >= due_s", "now_s >= due_s * 1000",
          "wrong unit: seconds as milliseconds"),
    Fault("news-kept", f"{SERVER}/outbox.py", "self._news.clear()", "pass",
          "stale news go out after the event that made them stale"),
    Fault("pick-edge", f"{SERVER}/pick.py", "u + v <= 1.0 + _EDGE", "u + v <= 2.0 + _EDGE",
          "a pick hits the parallelogram, not the triangle"),
    Fault("absence", f"{SERVER}/groups.py", "now_s >= barrier.deadline_s",
          "now_s > barrier.deadline_s + 60.0", "a barrier that opens a minute late"),
    Fault("websocket-length", f"{SERVER}/frame_cutter.py", "length >= 126", "length > 126",
          "boundary: a frame of 126 bytes is cut in the wrong place"),
    # -- pipeline
    Fault("extent", f"{PIPELINE}/geometry/segments.py", "(most - least).max(axis=1)",
          "(most - least).min(axis=1)", "swapped axes: extent by the shortest side"),
    Fault("similarity-scale", f"{PIPELINE}/geometry/similarity.py", "attribute_range / (high - low)",
          "attribute_range * (high - low)", "wrong unit: attributes are stretched, not fitted"),
    Fault("uv-seam", f"{PIPELINE}/geometry/uv.py", "code[same] == code[corner] and",
          "code[same] >= code[corner] and", "corners of different texture places share a vertex"),
    Fault("atlas-gutter", f"{PIPELINE}/geometry/atlas_pack.py", "(1 + 2 * GUTTER)", "(1 + GUTTER)",
          "charts bleed into each other: half a gutter"),
    Fault("gain-range", f"{PIPELINE}/geometry/photo_gains.py", "sum(axis=1) >= 2", "sum(axis=1) >= 1",
          "photos are matched by points that one of them sees alone"),
    Fault("lens-behind", f"{PIPELINE}/geometry/lens.py", "roots.real > 0.0", "roots.real < 0.0",
          "a sign: how far a lens may be used is found on the wrong side"),
    Fault("cover-tie", f"{PIPELINE}/geometry/cover.py", "gap <= max_gap or", "gap <= -max_gap or",
          "hand-off: only the nearest segment lies over a base face, so holes open"),
    Fault("trim-support", f"{PIPELINE}/geometry/trim.py", "distance_m <= reach_m[index]",
          "distance_m >= reach_m[index]", "surface is kept where no point supports it"),
    Fault("footprint-axes", f"{PIPELINE}/geometry/footprint.py", "(i < nx) & (j < nz)",
          "(i < nz) & (j < nx)", "swapped axes: a footprint that is not square"),
    Fault("stable-id", f"{PIPELINE}/geometry/region_match.py", ".similarity >= min_similarity",
          ".similarity >= min_similarity * 9", "regions lose their ids, and so their names"),
    Fault("exit-code", f"{PIPELINE}/cli/edge.py", "typer.Exit(130)", "typer.Exit(0)",
          "lost error: stopped by Ctrl-C, and reported as done"),
    Fault("wrong-option", f"{PIPELINE}/cli/edge.py", "2 if isinstance", "1 if isinstance",
          "lost error: wrong usage exits like a failed build"),
    Fault("report-bytes", f"{PIPELINE}/report_facts.py", "count < 1000 or", "count < 1024 or",
          "wrong unit in the report: 1,010 kB"),
    Fault("region-count", f"{PIPELINE}/stages/segment.py", "region_count > MAX_REGIONS",
          "region_count > MAX_REGIONS * 2**32", "a missing bound on regions"),
    # -- SDK (Python)
    Fault("visible", f"{SDK}/cover.py", "(self._missing < self._total)", "(self._missing > self._total)",
          "the rim where base and detail overlap is never known"),
    Fault("evict-pinned", f"{SDK}/cache.py", "if segment not in self._pinned", "",
          "what is shown is evicted"),
    Fault("credit", f"{SDK}/session.py", "max(1, credit // 2)", "max(1, credit * 2)",
          "credit is granted when none is left: the stream stands still"),
    # -- viewer (TypeScript)
    Fault("web-trim", f"{WEB}/core/session/cache.ts", "if (this.#pinned.has(segment)) continue;", "",
          "what is shown is evicted"),
    Fault("web-frame-end", f"{WEB}/core/wire/frames.ts", "if (end > total)", "if (end > total + 1)",
          "off by one: a chunk may run a byte past the end"),
    Fault("web-int16", f"{WEB}/core/wire/msgpack-writer.ts", "value >= -0x8000)", "value >= -0x18000)",
          "silent truncation of a number"),
    Fault("web-arc", f"{WEB}/xr/arc.ts", "2 * gravityMS2 * maxDropM", "gravityMS2 * maxDropM",
          "a teleport arc ends above the pit's floor"),
    Fault("web-bytes", f"{WEB}/app/format.ts", "bytes < 1000)", "bytes < 1024)",
          "wrong unit: 1,010 B"),
    # -- C# core
    Fault("csharp-axes", f"{CSHARP}/Runtime/Axes.cs", "Vec3(place.X, place.Y, -place.Z)",
          "Vec3(place.X, place.Y, place.Z)", "swapped axes: the scene is its mirror image"),
    Fault("csharp-radius", f"{CSHARP}/Core/Sessions/AimState.cs", "radiusM > 0 &&", "radiusM >= 0 &&",
          "boundary: an aim of radius 0 leaves the client"),
    Fault("csharp-frame", f"{CSHARP}/Core/Wire/PayloadFrame.cs", "size <= header)", "size < header)",
          "boundary: a frame without a payload byte"),
    # -- C++ core
    Fault("cpp-hidden", f"{CPP}/CoverCounters.cpp", "if (--missing_[faces_[entry]] == 0)",
          "if (--missing_[faces_[entry]] <= 1)", "hand-off: a base face is hidden too early, a hole"),
    Fault("cpp-backoff", f"{CPP}/Backoff.cpp", "kLongestMs = 30000", "kLongestMs = 30",
          "wrong unit: reconnects every 30 ms"),
    Fault("cpp-map", f"{CPP}/MsgpackReader.cpp", "token <= 0x8F", "token < 0x8F",
          "boundary: a map of 15 fields is read as a list"),
    # -- shader, deployment, spec, corpus
    Fault("shader-side", f"{CSHARP}/Runtime/Shaders/TerraportGround.hlsl", "pushM * length(", "pushM * lenght(",
          "a shader that no longer compiles"),
    Fault("compose-stage", "docker/compose.yaml", "target: web", "target: wbe",
          "a service built from a stage that does not exist"),
    Fault("spec-table", "spec/wire-protocol.md", "| text 0..1024 |", "| text 0..1025 |",
          "the specification's table says another limit than the code"),
    Fault("corpus-scene", "tests/conformance/scene/tiny/scene.json", "0.000244140625",
          "0.00048828125", "the corpus says another step: every position doubles"),
    Fault("corpus-message", "tests/conformance/wire/good/msgpack-credit-full.json",
          "9007199254740991", "9007199254740990", "the corpus says another number than its bytes"),
)  # fmt: skip
