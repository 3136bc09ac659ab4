"""``terraport upload``: put a scene into object storage."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from terraport_pipeline.cli.edge import reporting_errors
from terraport_pipeline.progress import RichProgress
from terraport_store import OriginError, is_url, meant_url, read_manifest

__all__ = ["register", "upload"]


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
    errors = Console(stderr=True)
    with reporting_errors(errors):
        # (1) refuse what cannot be sent
        if not is_url(url):
            example = meant_url(url) or "s3://BUCKET/PREFIX/NAME"
            raise OriginError(url, f"is a path, expected an address like {example}")
        try:
            from terraport_store.origin import ObjectOptions  # needs an extra
            from terraport_store.upload import upload_scene
        except ModuleNotFoundError as missing:
            if missing.name != "obstore":
                raise
            what = "needs the package obstore; install it with: pip install 'terraport[s3]'"
            raise OriginError(url, what) from None
        # (2) send; the last file, scene.json, is what readers see
        manifest = read_manifest(scene)
        total = sum(file.bytes for file in manifest.files.values())
        options = ObjectOptions(endpoint=endpoint, region=region)
        with RichProgress(errors) as bar:
            bar.start("upload", total, "bytes")
            report = upload_scene(
                scene,
                url,
                options,
                prune=prune,
                progress=lambda _path, done, _all: bar.advance(done),
            )
            bar.done({"files": report.sent_files, "bytes": report.sent_bytes})
    there = f", {report.kept_files} files were there" if report.kept_files else ""
    typer.echo(f"{url}: version {report.version[:12]}, {report.sent_bytes} bytes sent{there}")
    for folder in report.removed_versions:
        typer.echo(f"removed {folder}")
