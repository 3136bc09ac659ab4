"""The planted faults can still be planted; ``run.py`` says what notices them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from planted.table import FAULTS, Fault

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_text_that_a_fault_replaces_occurs_once(fault: Fault) -> None:
    assert (ROOT / fault.path).read_text(encoding="utf-8").count(fault.old) == 1
    assert fault.new != fault.old


def test_there_are_faults_of_every_part_and_language() -> None:
    faults_by_folder = Counter(fault.path.partition("/")[0] for fault in FAULTS)
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) >= 30
    assert {"wire", "payload", "store", "server", "pipeline", "client_sdk", "docker"} <= set(
        faults_by_folder
    )
    endings = {Path(fault.path).suffix for fault in FAULTS}
    assert {".py", ".ts", ".cs", ".cpp", ".hlsl", ".md", ".json", ".yaml"} <= endings
