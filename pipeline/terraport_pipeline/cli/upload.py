"""``terraport upload``: put a scene into object storage."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.console import Console

from terraport_pipeline.cli.edge import reporting_errors

if TYPE_CHECKING:
    from terraport_pipeline.progress import RichProgress

__all__ = ["register", "upload"]

_KB: Final = 1000
"""A bar of whole bytes is wider than 80 columns."""


def register(app: typer.Typer) -> None:
    """Add ``terraport upload`` to the command line `app`."""
    app.command("upload")(upload)


def upload(
    scene: Annotated[Path, typer.Argument(help="Scene directory.", show_default=False)],
    url: Annotated[
        str, typer.Argument(help="Where it shall lie: s3://BUCKET/PREFIX/NAME.", show_default=False)
    ],
    endpoint: Annotated[
        str | None,
        typer.Option(help="Address of the S3 service. [default: AWS_ENDPOINT_URL, else Amazon's]"),
    ] = None,
    region: Annotated[
        str | None, typer.Option(help="Region. [default: AWS_REGION, else us-east-1]")
    ] = None,
    prune: Annotated[
        bool,
        typer.Option("--prune", help="Delete older versions, but the one published before."),
    ] = False,
) -> None:
    """Put a scene into object storage, where terraport serve can read it.

    Readers see the old version, or the new one whole: scene.json goes last. What an interrupted
    upload has brought there whole is not sent again. Credentials come from the environment
    (AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY) or the machine's role.

    For example:

        terraport upload scenes/quarry s3://bucket/scenes/quarry

        terraport upload scenes/quarry s3://bucket/quarry --endpoint http://127.0.0.1:9000

        terraport serve s3://bucket/scenes
    """
    from terraport_pipeline.progress import RichProgress
    from terraport_store import OriginError, is_url, meant_url, needing_obstore, read_manifest

    errors = Console(stderr=True)
    with reporting_errors(errors):
        # (1) refuse what cannot be sent
        if not is_url(url):
            example = meant_url(url) or "s3://BUCKET/PREFIX/NAME"
            raise OriginError(url, f"is a path, expected an address like {example}")
        with needing_obstore(url):
            from terraport_store.origin import ObjectOptions
            from terraport_store.upload import upload_scene
        # (2) send; the last file, scene.json, is what readers see
        manifest = read_manifest(scene)
        total = sum(file.bytes for file in manifest.files.values())
        options = ObjectOptions(endpoint=endpoint, region=region)
        with RichProgress(errors) as bar:
            advance = None
            if errors.is_terminal:  # elsewhere the last line says it all
                advance = _CountedFiles(bar, len(manifest.files), total).advance
            report = upload_scene(scene, url, options, prune=prune, progress=advance)
            bar.done({})
    there = f", {report.kept_files} files were there" if report.kept_files else ""
    sent = f"{report.sent_files} files, {report.sent_bytes} bytes sent"
    typer.echo(f"{url}: version {report.version[:12]}, {sent}{there}")
    for folder in report.removed_versions:
        typer.echo(f"removed {folder}")


class _CountedFiles:
    """Shows bytes as they go, and which file of how many they are of."""

    def __init__(self, bar: RichProgress, count: int, total_bytes: int) -> None:
        self._bar = bar
        self._count = count
        self._paths: dict[str, None] = {}
        bar.start(f"{count} files", total_bytes / _KB, "kB")

    def advance(self, path: str, done_bytes: int, _all_bytes: int) -> None:
        """Take what ``upload_scene`` tells."""
        if path not in self._paths:
            self._paths[path] = None
            name = path.rpartition("/")[2]
            self._bar.describe(f"{name} {len(self._paths)}/{self._count}")
        self._bar.advance(done_bytes / _KB)
