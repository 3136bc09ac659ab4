from __future__ import annotations

from terraport_pipeline.code_digest import code_digest, modules_behind, without_docstrings

STAGES = "terraport_pipeline.stages."


def test_a_stage_depends_on_what_it_imports_and_on_the_child_it_starts() -> None:
    behind = modules_behind(STAGES + "tiles.solve_tile")
    for name in (
        "terraport_pipeline.stages.tiles.solve_tile",
        "terraport_pipeline.engines.poisson",
        "terraport_pipeline.engines.poisson_child",
        "terraport_pipeline.geometry.mesh.trim",
        "terraport_pipeline.geometry.clouds.carry",
    ):
        assert name in behind


def test_a_stage_does_not_depend_on_later_ones() -> None:
    """A better cover must not cost another reconstruction."""
    for name in ("tiles.solve_tile", "tiles.joined_tile"):
        behind = modules_behind(STAGES + name)
        assert "terraport_pipeline.geometry.cover.cover" not in behind
        assert "terraport_pipeline.stages.pack" not in behind
    cover = "terraport_pipeline.geometry.cover.cover"
    assert cover not in modules_behind(STAGES + "tiles.tiled_segment")
    assert cover in modules_behind(STAGES + "tiles.base_cover")
    assert "terraport_payload.glb_encode" in modules_behind(STAGES + "tiles.tiled_pack")


def test_what_is_only_said_does_not_count() -> None:
    assert "terraport_pipeline.progress" not in modules_behind(STAGES + "clean")
    assert "terraport_pipeline.option" not in modules_behind(STAGES + "clean")


def test_other_peoples_modules_do_not_count() -> None:
    assert all(name.startswith("terraport_") for name in modules_behind(STAGES + "read"))


def test_digests_differ_and_are_stable() -> None:
    digests = [code_digest(STAGES + name) for name in ("read", "clean", "segment", "pack")]
    assert len(set(digests)) == 4
    assert digests[0] == code_digest(STAGES + "read")


def test_docstrings_do_not_count_and_everything_else_does() -> None:
    """The help of an option is a docstring: a better word must cost no reconstruction."""
    code = '''"""A module."""
SIDE = 3
"""Metres
wide."""
def area(side: int) -> str:
    """Square."""
    return """kept""" + str(side)  # kept
'''
    kept = '''SIDE = 3
def area(side: int) -> str:
    return """kept""" + str(side)  # kept
'''
    assert without_docstrings(code) == kept
    assert without_docstrings(code.replace("wide", "long")) == kept
    assert without_docstrings(code.replace("SIDE = 3", "SIDE = 4")) != kept
