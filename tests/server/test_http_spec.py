"""The tables of spec/protocol.md, section 11, beside what a running service answers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import httpx
import pytest
from eventually import eventually
from server.grid_scene import GridScene, write_grid_scene

from terraport_server import BackgroundServer
from terraport_store import end_building, say_building

SPEC: Final = Path(__file__).resolve().parents[2] / "spec" / "protocol.md"
TOKEN: Final = "sixteen-characters"
JSON_TYPES: Final = {
    "text": str,
    "integer": int,
    "number": float,
    "map of text": dict,
    "list of scene lines": list,
    "list of building lines": list,
}

Rows = dict[str, tuple[str, bool]]


def tables() -> dict[str, Rows]:
    """Type of each member and whether it is required, by the first words before its table."""
    section = SPEC.read_text().split("## 11. ")[1].split("**Versions.**")[0]
    rows_by_table: dict[str, Rows] = {}
    for before, table in re.findall(r"(.*)\n\n\| member .*\n\|[- |]+\n((?:\|.*\n)+)", section):
        rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in table.splitlines()]
        rows_by_table[before[:20]] = {
            row[0].strip("`"): (row[1], row[2] == "required") for row in rows
        }
    return rows_by_table


LISTED, LINE, BUILDING, SCENE, LINKS = tables().values()


def assert_is(answer: dict[str, Any], rows: Rows) -> None:
    """The answer has the required members, none beside those of the table, and their types."""
    assert (
        {name for name, (_, required) in rows.items() if required} <= answer.keys() <= rows.keys()
    )
    for name, value in answer.items():
        assert type(value) is JSON_TYPES[rows[name][0]], name
        if rows[name][0] == "map of text":
            assert all(type(text) is str for text in value.values()), name


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> list[GridScene]:
    """`a` has a report, `b` has none."""
    root = tmp_path_factory.mktemp("http")
    grids = [write_grid_scene(root / scene_id, cells=2) for scene_id in ("b", "a")]
    (root / "a" / "report.html").write_text("<p>good")
    return grids


@pytest.fixture(scope="module")
def http(scenes: list[GridScene]) -> Iterator[httpx.Client]:
    with (
        BackgroundServer(scenes[0].path.parent) as running,
        httpx.Client(base_url=running.url) as client,
    ):
        yield client


def test_the_section_has_the_five_tables() -> None:
    assert list(tables()) == [
        "`GET /scenes`: what ",
        "A scene line:",
        "A building line:",
        "`GET /scenes/{id}`: ",
        "Links:",
    ]


def test_the_list_of_scenes_is_as_the_tables_say(http: httpx.Client) -> None:
    answer = http.get("/scenes").json()
    assert_is(answer, LISTED)
    assert [line["id"] for line in answer["scenes"]] == ["a", "b"]
    for line in answer["scenes"]:
        assert_is(line, LINE)
        assert_is(line["links"], LINKS)
        assert re.fullmatch("[0-9a-f]{32}", line["version"])
        assert ("report" in line["links"]) == (line["id"] == "a")


def test_a_build_is_listed_while_it_speaks(tmp_path: Path) -> None:
    grid = write_grid_scene(tmp_path / "a", cells=2)
    with BackgroundServer(grid.path.parent, scene_poll_s=0.05, token=TOKEN) as running:

        def lines() -> list[dict[str, Any]]:
            headers = {"Authorization": f"Bearer {TOKEN}"}
            answer = httpx.get(f"{running.url}/scenes", headers=headers).json()
            assert_is(answer, LISTED)
            building: list[dict[str, Any]] = answer.get("building", [])
            for line in building:
                assert_is(line, BUILDING)
            return building

        assert lines() == []
        say_building(tmp_path / "pit", "The pit", "read", None)
        say_building(tmp_path / "a", "A", "pack", 0.25)
        eventually(lambda: len(lines()) == 2)
        assert lines() == [
            {"id": "a", "name": "A", "step": "pack", "share": 0.25},
            {"id": "pit", "name": "The pit", "step": "read"},
        ]
        end_building(tmp_path / "pit")
        end_building(tmp_path / "a")
        eventually(lambda: lines() == [])


def test_a_guarded_service_answers_in_the_same_form(scenes: list[GridScene]) -> None:
    with BackgroundServer(scenes[0].path.parent, token=TOKEN) as guarded:
        headers = {"Authorization": f"Bearer {TOKEN}"}
        assert_is(httpx.get(f"{guarded.url}/scenes", headers=headers).json(), LISTED)
        refused = httpx.get(f"{guarded.url}/scenes")
        assert refused.status_code == 401
        assert set(refused.json()) == {"error"}
        assert set(refused.json()["error"]) == {"code", "message"}


def test_a_scene_is_its_manifest_and_what_the_table_adds(
    http: httpx.Client, scenes: list[GridScene]
) -> None:
    answer = http.get("/scenes/a").json()
    manifest = scenes[1].manifest.model_dump(mode="json")
    added = {name: answer.pop(name) for name in answer.keys() - manifest.keys()}
    assert answer == manifest
    assert_is(added, SCENE)
    assert_is(added["links"], LINKS)
    documented = re.findall(r"^\| `(\w+)` \|", _manifest_table(), re.M)
    assert sorted(manifest) == sorted(documented)


def test_every_link_answers_and_those_with_a_version_are_of_it(http: httpx.Client) -> None:
    answer = http.get("/scenes/a").json()
    links = answer["links"]
    del links["stream"]
    links["segment"] = links["segment"].replace("{segment}", "0")
    for name, link in links.items():
        assert http.get(f"/{link}").status_code == 200, name
        versioned = name in {"base", "regions", "segment"}
        assert link.endswith(f"?v={answer['version']}") == versioned, name
        if versioned or name == "self":
            gone = http.get(f"/{link.split('?')[0]}", params={"v": "0" * 32})
            assert (gone.status_code, gone.json()["error"]["code"]) == (404, "unknown_scene"), name


def _manifest_table() -> str:
    format_spec = SPEC.with_name("scene-format.md").read_text()
    return format_spec.split("## 4. scene.json")[1].split("`textures`, in scenes")[0]
