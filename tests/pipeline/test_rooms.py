"""The pipeline's rooms: a folder that grows past a glance is two."""

from pathlib import Path

ROOM = Path(__file__).parents[2] / "pipeline" / "terraport_pipeline"
MAX_FILES = 25


def test_no_room_has_more_files_than_a_glance_takes_in() -> None:
    rooms = [ROOM, *(path for path in ROOM.rglob("*") if path.is_dir())]
    sizes = {str(room.relative_to(ROOM)): len(list(room.glob("*.py"))) for room in rooms}
    assert len(sizes) > 15
    assert {name: count for name, count in sizes.items() if count > MAX_FILES} == {}


def test_every_room_says_what_it_is_about() -> None:
    for path in ROOM.rglob("__init__.py"):
        assert path.read_text(encoding="utf-8").startswith('"""'), path
