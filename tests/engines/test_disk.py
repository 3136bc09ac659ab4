"""A second run of an engine client: what was kept on disk, and what becomes of damaged files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from engines.programs import Client, Landed
from faults.service import Service

LANDING = "land:30,1,30,9"
WRITTEN = "pause:700"
"""What waits to be written is dropped by an early end."""


def visit(client: Client, server: Service, **options: object) -> Landed:
    """Land once, and give the disk time."""
    landed = client.land(f"{server.url}/scenes/grid", LANDING, WRITTEN, staged=1, **options)
    assert landed.exit_code == 0, landed.output
    return landed


def shown(landed: Landed) -> dict[str, Any]:
    """Return what would be drawn."""
    return {name: landed.stage[name] for name in ("visible", "hidden_base_faces", "digest")}


def files(folder: Path) -> list[Path]:
    """Return the kept payloads."""
    return sorted(folder.glob("*/*.segment-2"))


def test_a_second_run_reads_from_disk(client: Client, server: Service, tmp_path: Path) -> None:
    first = visit(client, server, disk=tmp_path)
    assert first.stats["payload_bytes"] > 0
    assert len(files(tmp_path)) == len(first.stage["visible"])
    second = visit(client, server, disk=tmp_path, threaded=1)
    assert second.stats["payload_bytes"] == 0
    assert shown(second) == shown(first)


def test_a_damaged_file_is_loaded_anew(client: Client, server: Service, tmp_path: Path) -> None:
    first = visit(client, server, disk=tmp_path)
    damaged = files(tmp_path)[3]
    data = bytearray(damaged.read_bytes())
    data[-1] ^= 1
    damaged.write_bytes(data)
    second = visit(client, server, disk=tmp_path)
    assert second.stats["payload_bytes"] == len(data) - 64
    assert shown(second) == shown(first)
    data[-1] ^= 1
    assert damaged.read_bytes() == data, "it is kept again, whole"


def test_the_bound_holds(client: Client, server: Service, tmp_path: Path) -> None:
    bound = 8_000
    first = visit(client, server, disk=tmp_path, disk_bytes=bound)
    assert first.stats["payload_bytes"] > bound
    assert 0 < sum(path.stat().st_size for path in files(tmp_path)) <= bound


def test_a_folder_that_cannot_be_written_is_no_error(
    client: Client, server: Service, tmp_path: Path
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("a file where the folder should be")
    landed = visit(client, server, disk=blocked)
    assert shown(landed) == shown(visit(client, server))
    assert blocked.read_text() == "a file where the folder should be"
