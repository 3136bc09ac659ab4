"""Which client can do what, each claim by a test: ``python tests/engines/support.py [--check]``.

Writes the matrix of ``docs/topics/clients.md`` between its marks. A claim names a file and a test
in it; `missing_tests` finds those that are not there (any more), so that a cell cannot outlive its
test.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

__all__ = ["CLIENTS", "FEATURES", "PAGE", "No", "matrix", "missing_tests", "page_text"]

ROOT: Final = Path(__file__).resolve().parents[2]
PAGE: Final = ROOT / "docs" / "topics" / "clients.md"
BEGIN: Final = "<!-- generated: matrix -->"
END: Final = "<!-- end -->"
CLIENTS: Final = ("Python SDK", "viewer (web)", "Unity (C#)", "Unreal (C++)", "Godot (GDScript)")

WEB: Final = "client_sdk/web/test"
UNITY_CORE: Final = "tests/engines/test_unity_core.py"
UNITY: Final = "tests/engines/test_unity_visits.py"
UNREAL_CORE: Final = "tests/engines/test_unreal_core.py"
UNREAL: Final = "tests/engines/test_unreal.py"
LAYER: Final = "tests/engines/test_engine_layers.py"
TOUR: Final = "test_everything_that_a_visitor_does"


@dataclass(frozen=True)
class No:
    """What a client cannot do, and why."""

    reason: str


@dataclass(frozen=True)
class Yes:
    """A test that shows it; ``short`` of what it is not."""

    file: str
    test: str
    short: str = ""


Claim = Yes | No


def both(file: str, test: str) -> tuple[Claim, Claim]:
    """One test that runs for both engine clients' cores."""
    return Yes(file, test), Yes(file, test)


SERVER = Yes(f"{WEB}/client/server.test.ts", "a landing, a hop and a return")
SDK_LAND = "tests/socket/test_sdk_sessions.py"
SDK_CORE = "tests/sdk/test_core.py"

FEATURES: Final[dict[str, tuple[Claim, Claim, Claim, Claim]]] = {
    "wire corpus, whole": (
        Yes("tests/conformance/test_messages_corpus.py", "test_case"),
        Yes(f"{WEB}/wire-corpus.test.ts", "from a server"),
        Yes(UNITY_CORE, "test_the_whole_corpus_passes"),
        Yes(UNREAL_CORE, "test_messages"),
    ),
    "payload corpus": (
        Yes("tests/conformance/scene/test_scene_corpus.py", "test_payload"),
        Yes(f"{WEB}/payload-corpus.test.ts", "runs every segment of the corpus"),
        Yes(UNITY_CORE, "test_the_whole_corpus_passes"),
        Yes(UNREAL_CORE, "test_payload"),
    ),
    "session corpus, step by step": (
        Yes("tests/conformance/test_landings_corpus.py", "test_every_history"),
        Yes(f"{WEB}/session/corpus.test.ts", "the landings corpus"),
        Yes(UNITY_CORE, "test_the_whole_corpus_passes"),
        Yes(UNREAL_CORE, "test_histories"),
    ),
    "segments array for array as the Python SDK": (
        Yes(SDK_LAND, "test_a_landing_brings_every_segment_within_the_radius"),
        SERVER,
        Yes(UNITY, "test_segments_are_those_of_the_python_sdk"),
        Yes(UNREAL, "test_segments_are_those_of_the_sdk_array_for_array"),
    ),
    "visible sets of a walk as the Python SDK": (
        Yes(SDK_LAND, "test_after_every_hop_exactly_what_is_within_the_radius_is_shown"),
        Yes(f"{WEB}/client/server.test.ts", "visible sets are those of the Python SDK"),
        Yes(UNITY, "test_a_walk_shows_and_hides_what_the_python_sdk_does"),
        Yes(UNREAL, "test_what_is_drawn_after_each_landing_is_what_the_sdk_shows"),
    ),
    "a second visit costs no bytes": (
        Yes(SDK_CORE, "test_what_stays_is_named_and_comes_once"),
        SERVER,
        Yes(UNITY, "test_a_return_is_shown_at_once_and_costs_no_bytes"),
        Yes(UNREAL, "test_what_is_drawn_after_each_landing_is_what_the_sdk_shows"),
    ),
    "a newer landing supersedes": (
        Yes(SDK_LAND, "test_a_newer_landing_supersedes_the_older"),
        Yes(f"{WEB}/client/server.test.ts", "a newer landing supersedes the older"),
        Yes(UNITY, "test_a_newer_landing_supersedes_the_older"),
        Yes(UNREAL, "test_a_newer_landing_supersedes_the_older"),
    ),
    "budgets": (
        Yes(SDK_LAND, "test_budgets_are_never_exceeded"),
        Yes(f"{WEB}/session/corpus.test.ts", "the landings corpus"),
        Yes(UNITY, "test_budgets_are_never_exceeded"),
        Yes(UNREAL, "test_budgets_are_never_exceeded"),
    ),
    "deadline: the inner part first": (
        Yes(SDK_LAND, "test_a_deadline_makes_the_inner_set_presentable"),
        Yes("tests/browser/test_faults.py", "test_past_the_deadline_the_inner_part_is_shown_first"),
        Yes(UNITY, "test_a_deadline_shows_the_inner_part_first"),
        Yes(UNREAL, "test_a_deadline_shows_the_inner_part_first"),
    ),
    "aims fetch ahead": (
        Yes(SDK_CORE, "test_an_aim_brings_ahead_what_a_landing_needs"),
        Yes(
            f"{WEB}/client/server.test.ts", "an aim, and the landing there has nothing left to load"
        ),
        Yes(UNITY, "test_an_aim_brings_what_the_landing_needs"),
        Yes(UNREAL, "test_an_aim_brings_what_the_landing_needs"),
    ),
    "picks": (
        Yes(SDK_LAND, "test_picks_find_the_ground_whether_loaded_or_not"),
        Yes(f"{WEB}/session/corpus.test.ts", "the landings corpus"),
        Yes(UNITY, "test_picks_are_answered"),
        Yes(UNREAL, "test_picks_are_answered"),
    ),
    "cache bounded by bytes": (
        Yes(SDK_CORE, "test_nothing_that_was_named_leaves_memory_before_the_swap"),
        Yes(f"{WEB}/session/parts.test.ts", "evicts the least recently used that nothing needs"),
        Yes(UNITY, "test_memory_is_bounded"),
        Yes(UNREAL, "test_what_leaves_the_cache_is_sent_again"),
    ),
    "cache on disk": (
        Yes("tests/socket/test_sdk_disk.py", "test_a_second_run_reads_from_disk"),
        Yes("tests/browser/test_landings.py", "test_a_reload_loads_nothing_twice"),
        Yes(UNITY, "test_a_second_run_reads_from_disk"),
        Yes(UNREAL, "test_a_second_run_reads_from_disk_and_damage_is_asked_for_again"),
    ),
    "disk: damaged, full, not to be written": (
        Yes("tests/sdk/test_disk.py", "test_a_disk_that_cannot_be_written_is_no_error"),
        Yes(
            f"{WEB}/client/disk-cache.test.ts",
            "a disk that cannot be used keeps nothing, and is no error",
        ),
        Yes(UNITY, "test_the_disk_is_bounded_and_need_not_be_there"),
        Yes(UNREAL, "test_the_disk_keeps_its_bound_and_one_that_cannot_be_written_is_no_error"),
    ),
    "a cut line is mended, nothing comes twice": (
        Yes("tests/socket/test_sdk_reconnect.py", "test_a_landing_survives_any_number_of_cuts"),
        Yes(f"{WEB}/client/server.test.ts", "a cut line is mended, no segment comes twice"),
        Yes(UNITY, "test_a_cut_connection_is_made_again_and_no_byte_comes_twice"),
        Yes(UNREAL, "test_a_cut_line_is_mended_and_no_segment_comes_twice"),
    ),
    "a service that is killed and comes back": (
        Yes("tests/socket/test_sdk_reconnect.py", "test_a_server_that_restarts_with_a_new_version"),
        Yes("tests/browser/test_faults.py", "test_the_server_is_killed_and_starts_again"),
        Yes(UNITY, "test_a_service_that_is_killed_and_comes_back"),
        Yes(UNREAL, "test_a_service_that_is_killed_and_comes_back"),
    ),
    "a flipped bit is found, the segment sent again": (
        Yes(
            "tests/socket/test_sdk_reconnect.py",
            "test_a_bit_flipped_on_the_way_is_found_and_sent_again",
        ),
        Yes(f"{WEB}/session/corpus.test.ts", "the landings corpus"),
        Yes(UNITY, "test_a_flipped_bit_is_found_and_the_segment_asked_for_again"),
        Yes(UNREAL, "test_a_flipped_byte_is_noticed_and_the_segment_asked_for_again"),
    ),
    "tokens; a refused one is not repeated": (
        Yes(SDK_LAND, "test_tokens"),
        Yes(f"{WEB}/client/server.test.ts", "a wrong one is told and not repeated"),
        Yes(UNITY, "test_a_token_opens_and_a_refused_one_is_not_repeated"),
        Yes(UNREAL, "test_a_token_opens_a_wrong_one_is_told_once_and_a_right_one_mends_it"),
    ),
    "tokens that a function renews": (
        Yes("tests/socket/test_sdk_tokens.py", "test_a_session_outlives_its_tokens"),
        Yes(f"{WEB}/client/link.test.ts", "a refused token that it has renewed is no end"),
        Yes(UNITY, "test_a_session_outlives_its_tokens"),
        Yes(UNREAL, "test_a_session_outlives_its_tokens"),
    ),
    "base hidden by the cover, swap at once": (
        Yes(SDK_LAND, "test_base_and_hidden_faces"),
        Yes("tests/browser/test_landings.py", "test_what_is_drawn_is_what_the_sdk_shows"),
        Yes(UNITY, "test_a_walk_shows_and_hides_what_the_python_sdk_does"),
        Yes(UNREAL, "test_what_is_drawn_after_each_landing_is_what_the_sdk_shows"),
    ),
    "ground under feet and pointers, of what is shown": (
        No("ask a pick"),
        Yes("tests/browser/test_walk.py", "test_feet_stand_on_what_is_shown"),
        Yes(UNITY, "test_feet_stand_on_what_is_shown"),
        Yes(UNREAL, "test_feet_stand_on_what_is_shown"),
    ),
    "teleport in the dark of a fade": (
        No("no user"),
        Yes(
            "tests/browser/test_headset.py",
            "test_a_teleport_swaps_and_moves_in_one_black_frame",
        ),
        Yes(LAYER, "test_the_unity_scene_lands_on_the_stubs"),
        Yes(UNREAL, TOUR),
    ),
    "shown when asked for, in place of at once": (
        No("shows nothing"),
        Yes(f"{WEB}/xr-teleport.test.ts", "presentable"),
        Yes(LAYER, "test_the_unity_scene_lands_on_the_stubs"),
        Yes(UNREAL, TOUR),
    ),
    "bounds by the kind of device": (
        No("bounds are the caller's"),
        Yes(f"{WEB}/session/parts.test.ts", "budgetsFor(device)"),
        *both("tests/engines/test_profiles.py", "test_profiles_are_the_same_in_both_engines"),
    ),
    "ground that is solid around the feet": (
        No("no bodies"),
        No("no bodies"),
        Yes(LAYER, "test_the_unity_scene_lands_on_the_stubs"),
        Yes(UNREAL, "test_feet_stand_on_what_is_shown"),
    ),
    "textures: decoded payload, image's bytes": (
        Yes("tests/socket/test_sdk_textures.py", "test_segments_arrive_with_their_images"),
        Yes("tests/browser/test_pictures.py", "test_ways_to_colour_the_ground"),
        Yes(UNITY, "test_images_colours_and_attributes_are_those_of_the_python_sdk"),
        Yes(UNREAL, "test_segments_are_those_of_the_sdk_array_for_array"),
    ),
    "segments that lack an attribute of the scene": (
        Yes(
            "tests/conformance/scene/test_scene_corpus.py",
            "test_an_attribute_of_one_segment_alone",
        ),
        Yes(f"{WEB}/versions/missing-attribute.test.ts", "height_change_m in view"),
        Yes(UNITY_CORE, "test_the_whole_corpus_passes"),
        Yes(UNREAL_CORE, "test_payload"),
    ),
    "axes, winding and V of the engine": (
        No("stays in the scene frame"),
        No("stays in the scene frame"),
        Yes(UNITY_CORE, "test_unity_draws_what_the_python_sdk_draws"),
        Yes(UNREAL, "test_the_engine_draws_what_the_sdk_draws"),
    ),
    "decoding allocates nothing in the steady state": (
        No("new arrays each time"),
        No("new arrays each time: they go to the GPU"),
        Yes(
            UNITY_CORE,
            "test_decoding_allocates_nothing_that_grows_with_a_segment",
            short="but .NET's inflater: 5 kB a segment",
        ),
        Yes(UNREAL_CORE, "test_decoding_is_fast_and_allocates_nothing_in_the_steady_state"),
    ),
    "places by name": (
        Yes("tests/sdk/test_places.py", "test_a_place_is_found_by_its_name_or_stable_id"),
        Yes(f"{WEB}/app-region-places.test.ts", "regionsToVisit"),
        Yes(UNITY_CORE, "test_places_and_pieces_are_those_of_the_python_sdk"),
        Yes(UNREAL, "test_places_and_pieces_are_those_of_the_sdk"),
    ),
    "coarser pieces that a pick is part of": (
        Yes("tests/sdk/test_places.py", "test_they_grow_from_cost_to_cost"),
        Yes(f"{WEB}/coarser-pieces.test.ts", "grows from cost to cost"),
        Yes(UNITY_CORE, "test_places_and_pieces_are_those_of_the_python_sdk"),
        Yes(UNREAL, "test_places_and_pieces_are_those_of_the_sdk"),
    ),
    "an aim stops at your own things": (
        No("no user"),
        No("no things but the ground"),
        Yes(LAYER, "test_the_unity_scene_lands_on_the_stubs"),
        Yes(UNREAL, TOUR),
    ),
    "preview in the editor": (
        No("no editor"),
        No("no editor"),
        Yes(LAYER, "test_the_unity_scene_lands_on_the_stubs", "on stubs of the engine's API"),
        Yes(UNREAL, TOUR, "on stubs of the engine's API"),
    ),
    "a coarser level in a ring, where the scene has one": (
        Yes(
            "tests/socket/test_levels.py",
            "test_a_ring_comes_at_the_coarser_level_and_hides_the_base",
        ),
        Yes(
            "tests/browser/test_levels.py",
            "test_a_landing_has_a_ring_and_the_base_gives_way_to_both",
        ),
        Yes(UNITY, "test_a_coarser_level_is_shown_in_a_ring"),
        Yes(UNREAL, "test_what_is_drawn_after_each_landing_is_what_the_sdk_shows"),
    ),
    "goes along with a group": (
        Yes("tests/socket/test_sdk_groups.py", "test_the_guide_lands_everybody"),
        Yes("tests/browser/test_groups.py", "test_who_guides_takes_the_others_along"),
        Yes(UNITY, "test_a_member_lands_where_the_guide_does"),
        Yes(UNREAL, "test_a_member_goes_where_the_guide_goes_if_it_follows"),
    ),
    "guides a group; who does not follow holds nobody up": (
        Yes("tests/socket/test_sdk_groups.py", "test_the_guide_lands_everybody"),
        Yes("tests/browser/test_groups.py", "test_who_guides_takes_the_others_along"),
        Yes(UNITY, "test_a_guide_takes_the_sdk_along"),
        Yes(UNREAL, "test_a_guide_takes_the_sdk_along_and_a_seat_outlives_a_cut_line"),
    ),
    "a group's components: seat, list of people, events": (
        No("no components"),
        Yes("tests/browser/test_groups.py", "test_who_guides_takes_the_others_along"),
        Yes(LAYER, "test_the_unity_scene_lands_on_the_stubs"),
        Yes(UNREAL, TOUR),
    ),
    "drawn in a headset": (
        No("no renderer"),
        Yes(
            "tests/browser/test_headset.py",
            "test_a_teleport_swaps_and_moves_in_one_black_frame",
            "emulated",
        ),
        Yes(LAYER, "test_the_unity_scene_lands_on_the_stubs", "on stubs of the engine's API"),
        Yes(UNREAL, TOUR, "on stubs of the engine's API"),
    ),
}


VISITS: Final = "tests/browser/test_godot.py"
HOP: Final = Yes(VISITS, "test_a_landing_a_hop_and_a_return")
PICTURES: Final = Yes(VISITS, "test_landings_look_as_in_the_viewer")
RAYS: Final = Yes(VISITS, "test_prefetched_ground_picks_and_rays")
HISTORIES: Final = Yes(VISITS, "test_every_history")
EXAMPLE: Final = Yes(VISITS, "test_the_example_walks")
NO_GROUPS: Final = No("left out for its size")

GODOT: Final[dict[str, Claim]] = {
    "wire corpus, whole": Yes(VISITS, "test_every_message_and_frame"),
    "payload corpus": Yes(VISITS, "test_every_payload"),
    "session corpus, step by step": Yes(VISITS, "test_every_history"),
    "segments array for array as the Python SDK": Yes(VISITS, "test_every_payload"),
    "visible sets of a walk as the Python SDK": HOP,
    "a second visit costs no bytes": HOP,
    "a newer landing supersedes": Yes(VISITS, "test_a_newer_landing_supersedes_the_older"),
    "budgets": HISTORIES,
    "deadline: the inner part first": Yes(
        VISITS, "test_past_the_deadline_the_inner_part_is_shown_first"
    ),
    "aims fetch ahead": RAYS,
    "picks": RAYS,
    "cache bounded by bytes": Yes(VISITS, "test_what_a_landing_left_is_freed"),
    "cache on disk": No("left out for its size"),
    "disk: damaged, full, not to be written": No("no disk cache"),
    "a cut line is mended, nothing comes twice": Yes(
        VISITS, "test_a_landing_survives_lost_connections"
    ),
    "a service that is killed and comes back": Yes(
        VISITS, "test_a_service_that_is_killed_comes_back_with_another_version"
    ),
    "a flipped bit is found, the segment sent again": HISTORIES,
    "tokens; a refused one is not repeated": Yes(
        VISITS, "test_a_token_opens_and_a_wrong_one_fails_once"
    ),
    "tokens that a function renews": No("set `token` and call `open` again"),
    "base hidden by the cover, swap at once": HOP,
    "ground under feet and pointers, of what is shown": RAYS,
    "teleport in the dark of a fade": EXAMPLE,
    "shown when asked for, in place of at once": EXAMPLE,
    "bounds by the kind of device": Yes(
        "client_sdk/godot/addons/terraport/terrain.gd", "Device.HEADSET", "by `device`"
    ),
    "ground that is solid around the feet": RAYS,
    "textures: decoded payload, image's bytes": PICTURES,
    "segments that lack an attribute of the scene": Yes(VISITS, "test_every_payload"),
    "axes, winding and V of the engine": PICTURES,
    "decoding allocates nothing in the steady state": No("new arrays each time"),
    "places by name": Yes(VISITS, "test_places_are_those_of_the_python_sdk"),
    "coarser pieces that a pick is part of": No("`fetch_json` gives the list of unions"),
    "an aim stops at your own things": No("rays meet the ground alone"),
    "preview in the editor": No("not begun"),
    "goes along with a group": NO_GROUPS,
    "guides a group; who does not follow holds nobody up": NO_GROUPS,
    "a group's components: seat, list of people, events": NO_GROUPS,
    "a coarser level in a ring, where the scene has one": Yes(
        VISITS, "test_a_ring_of_the_coarser_level_comes_and_can_be_left_out"
    ),
    "drawn in a headset": No("no rig; with one of the engine's it was not tried"),
}
"""What Godot shows, in the engine itself."""


def claims_of(feature: str) -> tuple[Claim, ...]:
    """Return the claims of a row, one for each of `CLIENTS`."""
    claims = FEATURES[feature]
    return (*claims, GODOT.get(feature, No("not begun")))


def missing_tests() -> list[str]:
    """Return the claims whose file or test is not there."""
    missing = []
    for feature in FEATURES:
        for client, claim in zip(CLIENTS, claims_of(feature), strict=True):
            if isinstance(claim, No):
                continue
            path = ROOT / claim.file
            text = path.read_text(encoding="utf-8") if path.is_file() else ""
            pattern = rf"def {claim.test}" if path.suffix == ".py" else re.escape(claim.test)
            if not re.search(pattern, text):
                missing.append(f"{feature}, {client}: {claim.file} has no {claim.test!r}")
    return missing


def matrix() -> str:
    """Return the table, each yes a link to the file of its test."""
    lines = [
        "|  | " + " | ".join(CLIENTS) + " |",
        "| -- " * (len(CLIENTS) + 1) + "|",
    ]
    for feature in FEATURES:
        cells = [_cell(claim) for claim in claims_of(feature)]
        lines.append(f"| {feature} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def page_text() -> str:
    """Return the page with the present matrix in its place."""
    text = PAGE.read_text(encoding="utf-8")
    head, rest = text.split(BEGIN)
    return f"{head}{BEGIN}\n\n{matrix()}\n\n{END}{rest.split(END, 1)[1]}"


def _cell(claim: Claim) -> str:
    if isinstance(claim, No):
        return f"no: {claim.reason}"
    word = "yes" if not claim.short else claim.short
    return f'[{word}](../../{claim.file} "{claim.test}")'


def main() -> int:
    """Write or check the page; return the exit code."""
    problems = missing_tests()
    current = PAGE.read_text(encoding="utf-8")
    page = page_text()
    if "--check" in sys.argv[1:]:
        if page != current:
            problems.append(f"{PAGE.name} is not what support.py writes")
    else:
        PAGE.write_text(page, encoding="utf-8")
    for problem in problems:
        sys.stderr.write(f"error: {problem}\n")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
