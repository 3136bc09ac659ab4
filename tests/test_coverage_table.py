from __future__ import annotations

import importlib.util
from pathlib import Path

PATH = Path(__file__).resolve().parents[1] / ".ci" / "coverage_table.py"


def test_a_line_a_package_and_each_module_below_the_least() -> None:
    spec = importlib.util.spec_from_file_location("coverage_table", PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    rows = module.table(
        [
            ("store/terraport_store/full.py", 80, 0),
            ("store/terraport_store/just.py", 10, 2),
            ("store/terraport_store/empty.py", 0, 0),
            ("client_sdk/python/terraport/cli/thin.py", 1000, 201),
        ]
    )
    assert [row.split() for row in rows[1:3]] == [
        ["terraport", "1", "1,000", "79.9", "%"],
        ["terraport_store", "3", "90", "97.8", "%"],
    ]
    assert rows[3] == "coverage: 1 modules below 80 %"
    assert rows[4].split() == [
        "79.9", "%", "201", "lines", "not", "run", "client_sdk/python/terraport/cli/thin.py",
    ]  # fmt: skip
    assert len(rows) == 5
