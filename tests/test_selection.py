"""Which tests `.ci/run changed` picks: on a small tree written out, and on this one."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]

CLI = "client_sdk/python/terraport/cli"
SMALL = {
    "store/shop/__init__.py": "from shop.reader import Reader\nfrom shop.writer import Writer",
    "store/shop/reader.py": "from shop.index import near\n\nclass Reader:\n    find = near",
    "store/shop/writer.py": "class Writer: ...",
    "store/shop/index.py": "def near(): ...",
    "store/shop/build.py": "from shop.writer import Writer\n\ndef run():\n    Writer()",
    f"{CLI}/__init__.py": "from terraport.cli.lazy import VERBS\nprint(VERBS)",
    f"{CLI}/lazy.py": "VERBS = (Verb('build', 'shop.build'), Verb('look', 'shop.reader'))",
    "spec/format.md": "",
    "data/small.las": "",
    "client_sdk/unity/Core/Aim.cs": "",
    "tests/conftest.py": """
import pytest

from shop import Reader, Writer

@pytest.fixture
def reader():
    return Reader()

@pytest.fixture
def found(reader):
    return reader.find()

@pytest.fixture
def writer():
    return Writer()
""",
    "tests/shop_scene.py": "from shop import Writer\n\ndef make():\n    Writer()",
    "tests/store/test_index.py": "from shop.index import near\n\ndef test_a():\n    near()",
    "tests/store/test_fixture.py": "def test_a(found): ...",
    "tests/store/test_helper.py": "import shop_scene\n\ndef test_a():\n    shop_scene.make()",
    "tests/store/test_spec.py": "ROOT = 1\nPAGE = ROOT / 'spec' / 'format.md'",
    "tests/store/test_data.py": "SURVEY = 'data/small.las'",
    "tests/store/test_program.py": "import sys\nRUN = [sys.with_name('terraport'), 'build']",
    "tests/end_to_end/test_all.py": "from shop import Reader\n\ndef test_a():\n    Reader()",
    "tests/engines/test_unity_core.py": "",
    "tests/engines/test_axes.py": "",
}


@pytest.fixture(scope="module")
def ci() -> Iterator[tuple[ModuleType, ModuleType]]:
    """The modules `selection` and `changed` of .ci."""
    sys.path.insert(0, str(ROOT / ".ci"))
    import changed
    import selection

    yield selection, changed
    sys.path.remove(str(ROOT / ".ci"))


@pytest.mark.parametrize(
    ("path", "tests"),
    [
        # Its own test first; then what asks for a fixture that reaches it; end to end last.
        ("store/shop/index.py", ["test_index", "test_fixture", "test_all"]),
        # The reader's users do not use the writer, though the package hands both on.
        ("store/shop/writer.py", ["test_helper", "test_program"]),
        ("store/shop/build.py", ["test_program"]),
        # Everybody runs a package's __init__.
        (
            "store/shop/__init__.py",
            ["test_fixture", "test_index", "test_helper", "test_program", "test_all"],
        ),
        ("spec/format.md", ["test_spec"]),
        ("data/small.las", ["test_data"]),
        ("tests/store/test_data.py", ["test_data"]),
        ("client_sdk/unity/Core/Aim.cs", ["test_unity_core", "test_axes"]),
        ("README.md", []),
    ],
)
def test_the_tests_that_reach_a_file_nearest_first(
    ci: tuple[ModuleType, ModuleType], path: str, tests: list[str]
) -> None:
    selected = ci[0].Tree(SMALL, SMALL.__getitem__).select([path]).tests
    assert [Path(selected_test.path).stem for selected_test in selected] == tests


def test_here_a_change_reaches_its_own_test_first_and_leaves_most_out(
    ci: tuple[ModuleType, ModuleType],
) -> None:
    """The whole of what it knows about this tree: imports, fixtures, the command line, files."""
    _selection, changed = ci
    picked = changed.select(["store/terraport_store/packed_rtree.py"])
    paths = [selected_test.path for selected_test in picked.tests]
    assert paths[0] == "tests/store/test_packed_rtree.py"
    for needed in (
        "tests/store/test_reader.py",
        "tests/socket/test_landings.py",
        "tests/end_to_end/test_whole_path.py",
        "tests/browser/test_landings.py",
    ):
        assert needed in paths
    assert "tests/wire/test_codec.py" not in paths
    assert "tests/pipeline/geometry/regions/test_similarity.py" not in paths


def test_the_merge_base_is_compared_with_unless_another_commit_is_given(
    ci: tuple[ModuleType, ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def git(*arguments: str) -> None:
        identity = ["-c", "user.name=a", "-c", "user.email=a@b"]
        subprocess.run(["git", *identity, *arguments], cwd=tmp_path, check=True)

    git("init", "-q", "-b", "main")
    for name in ("kept", "edited", "gone"):
        (tmp_path / name).write_text(name)
    git("add", ".")
    git("commit", "-qm", "base")
    git("checkout", "-qb", "topic")
    (tmp_path / "edited").write_text("once")
    git("commit", "-qam", "topic")
    (tmp_path / "gone").unlink()
    (tmp_path / "new").write_text("")
    monkeypatch.setattr(ci[1], "ROOT", tmp_path)
    assert ci[1].changed_files(None) == ["edited", "gone", "new"]
    assert ci[1].changed_files("HEAD") == ["gone", "new"]
