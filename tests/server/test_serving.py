"""`terraport serve` as a process: start, signals, errors."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
import typer
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient, assemble
from typer.testing import CliRunner

from terraport_server import BackgroundServer
from terraport_server.cli import register
from terraport_server.errors import ServerError, SettingsError
from terraport_wire import Credit, Notice, Plan, Ready

PROGRAM = """
import typer
from terraport_server.cli import register
app = typer.Typer()
register(app)
app()
"""


@contextmanager
def serving(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run the command; yield the process and its address."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *arguments, "--port", str(port)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    try:
        until_s = time.monotonic() + 30
        while True:
            try:
                # Answered, not only connected: who connects earlier waits in the socket's queue.
                httpx.get(f"http://127.0.0.1:{port}/healthz", timeout=30).raise_for_status()
                break
            except httpx.ConnectError:
                assert process.poll() is None, process.communicate()
                assert time.monotonic() < until_s
                time.sleep(0.05)
        yield process, f"http://127.0.0.1:{port}"
    finally:
        process.kill()
        process.communicate()


def run(*arguments: str) -> tuple[int, str]:
    app = typer.Typer()
    register(app)
    app.callback()(lambda: None)
    result = CliRunner().invoke(app, ["serve", *arguments])
    return result.exit_code, result.output


def test_sigterm_lets_the_open_landing_finish(tmp_path: Path) -> None:
    grid = write_grid_scene(tmp_path / "scenes" / "pit")
    with (
        serving(str(tmp_path / "scenes")) as (process, url),
        PlainClient(f"{url}/scenes/pit") as client,
    ):
        client.hello(credit_bytes=20_000)
        client.land(1, (30.0, 0.0, 30.0), 100.0)
        client.expect(Plan)
        process.send_signal(signal.SIGTERM)
        notice, before, _ = client.until(Notice)
        assert notice.kind == "draining"
        with PlainClient(f"{url}/scenes/pit") as late:
            error, code = late.refused()
        assert (error.code, code) == ("draining", 4503)
        client.send(Credit(bytes=1 << 30))
        _, frames, _ = client.until(Ready)
        assert assemble([*before, *frames]) == dict(enumerate(grid.payloads))
        assert client.closed() == 4503
        output, log = process.communicate(timeout=20)
    assert process.returncode == 0
    assert f"terraport serves {tmp_path / 'scenes'} at {url} (open to everyone" in output
    assert f"{url}/scenes/pit  grid: 36 segments" in output
    assert re.search(r"landing ready landing=[0-9a-f]{12}-1 scene=pit", log)
    assert "Traceback" not in log


def test_ctrl_c_ends_it_quietly(tmp_path: Path) -> None:
    with serving(str(tmp_path)) as (process, _):
        process.send_signal(signal.SIGINT)
        output, log = process.communicate(timeout=20)
    assert process.returncode == 0
    assert "Traceback" not in log
    assert "no scene yet" in output


def test_help_teaches() -> None:
    code, text = run("--help")
    assert code == 0
    for word in ("terraport land", "TERRAPORT_TOKEN", "--allow-open", "SIGTERM"):
        assert word in text


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["{dir}/nowhere"], "DIRECTORY: there is no folder {dir}/nowhere, expected a folder of"),
        (["{dir}/file"], "DIRECTORY: {dir}/file is a file, expected a folder of scenes"),
        (["s3:/bucket/x"], "DIRECTORY: got 's3:/bucket/x', expected s3://bucket/x for scenes in"),
        (
            ["s3://"],
            "DIRECTORY: s3://: cannot be used: expected an address like s3://BUCKET/PREFIX",
        ),
        (["ftp://x/y"], "DIRECTORY: ftp://x/y: cannot be used: "),
        (["{dir}", "--host", "0.0.0.0"], "--token: got none while listening on 0.0.0.0"),
        (["{dir}", "--token", "short"], "--token: got a token of 5 characters"),
        (["{dir}", "--tokens-file", "{dir}/file"], "--tokens-file: {dir}/file line 1: got a token"),
        (["{dir}", "--token-keys", "{dir}/no"], "--token-keys: {dir}/no: No such file"),
        (
            ["{dir}", "--max-radius", "-1"],
            "--max-radius: got '-1.0', expected a number gr",
        ),
        (
            ["{dir}", "--port", "70000"],
            "--port: got '70000', expected a number less than or ",
        ),
        (["{dir}", "--ssl-keyfile", "x"], "--ssl-keyfile: got one of ssl_certfile and ssl_keyfile"),
        (
            ["{dir}", "--ssl-keyfile", "{dir}/file", "--ssl-certfile", "{dir}/x"],
            "--ssl-certfile: there is no file {dir}/x, expected a PEM file",
        ),
        (
            ["{dir}", "--ssl-keyfile", "{dir}/file", "--ssl-certfile", "{dir}/file"],
            "--ssl-certfile: got {dir}/file, expected a certificate in PEM",
        ),
    ],
)
@pytest.mark.parametrize("workers", ["1", "2"])
def test_bad_options_are_said_before_any_address_and_exit_1(
    tmp_path: Path, arguments: list[str], text: str, workers: str
) -> None:
    (tmp_path / "file").write_text("name short\n")
    given = [argument.format(dir=tmp_path) for argument in arguments]
    if "--port" not in given:
        given += ["--port", "0"]
    code, output = run(*given, "--workers", workers)
    assert code == 1
    (line,) = output.splitlines()
    assert line.startswith(f"error: {text.format(dir=tmp_path)}")


def test_what_the_environment_says_wrongly_is_named_by_its_variable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TERRAPORT_MAX_RADIUS_M", "far")
    code, output = run(str(tmp_path))
    assert (code, output) == (
        1,
        "error: TERRAPORT_MAX_RADIUS_M: got 'far', expected a valid number\n",
    )


def test_beyond_this_machine_it_names_what_only_a_proxy_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "terraport_server.serving.run", lambda _settings, _options, announce: announce(1)
    )
    code, output = run(str(tmp_path), "--host", "0.0.0.0", "--token", "sixteen-characters")
    assert code == 0
    assert "Without a proxy in front, nothing limits idle connections" in output
    assert "proxy" not in run(str(tmp_path))[1]


def test_a_folder_that_is_given_wins_over_an_address_in_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TERRAPORT_SCENES_URL", "s3://bucket/scenes")
    code, output = run(str(tmp_path / "nowhere"))
    assert code == 1
    assert "there is no folder" in output


@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_port_in_use_is_an_error_and_nothing_else_is_said(tmp_path: Path, workers: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = str(listener.getsockname()[1])
        process = subprocess.run(
            [sys.executable, "-c", PROGRAM, str(tmp_path), "--port", port, "--workers", workers],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert process.returncode == 1
    assert process.stdout == ""  # no address that somebody else answers at
    (line,) = process.stderr.splitlines()
    assert line.startswith(f"error: could not listen on 127.0.0.1:{port}: ")
    assert line.endswith("choose another port: --port 0 for any free one")


def test_a_free_port_is_said_as_it_is(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(tmp_path), "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    try:
        assert process.stdout is not None
        line = re.search(r" at http://127\.0\.0\.1:(\d+) ", process.stdout.readline())
        assert line
        socket.create_connection(("127.0.0.1", int(line[1])), timeout=5).close()
    finally:
        process.kill()
        process.communicate()


def test_background_server_on_a_port_in_use_says_so(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        with pytest.raises(ServerError, match=f"could not listen on 127.0.0.1:{port}: "):
            BackgroundServer(tmp_path, port=port)


def test_background_server_refuses_what_serve_refuses(tmp_path: Path) -> None:
    with pytest.raises(SettingsError):
        BackgroundServer(tmp_path / "nowhere")


def test_background_server_stops_and_frees_its_port(tmp_path: Path) -> None:
    with BackgroundServer(tmp_path) as server:
        port = server.port
        assert server.url == f"http://127.0.0.1:{port}"
    server.stop()
    socket.create_server(("127.0.0.1", port)).close()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", port))


def test_a_service_that_does_not_start_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = BackgroundServer(tmp_path)

    async def broken() -> None:
        raise RuntimeError("no luck")

    monkeypatch.setattr(server.service, "start", broken)
    with pytest.raises(ServerError, match="did not start"):
        server.start()
