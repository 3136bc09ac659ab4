"""Access while the service runs: files read again, tokens taken back, certificates renewed."""

from __future__ import annotations

import datetime as dt
import ssl
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from eventually import eventually
from server.grid_scene import write_grid_scene
from server.plain_client import PlainClient

from terraport_server import BackgroundServer
from terraport_server.auth.keys import TokenKey, new_key, write_keys
from terraport_server.auth.tokens import make_token
from terraport_wire import Plan, Ready

KEY = TokenKey("k1", "HS256", bytes(range(32)))
PERIOD_S = 0.1
ANNA, BOB = "token-of-anna-16", "token-of-bob--16"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("access")
    write_grid_scene(folder / "pit", cells=2)
    write_grid_scene(folder / "quarry", cells=2)
    return folder


@pytest.fixture
def tokens(tmp_path: Path) -> Path:
    path = tmp_path / "tokens"
    path.write_text(f"anna {ANNA}\nbob {BOB} pit\n")
    return path


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    path = tmp_path / "keys"
    write_keys(path, [KEY.line()])
    return path


@pytest.fixture
def server(folder: Path, tokens: Path, keys: Path) -> Iterator[BackgroundServer]:
    with BackgroundServer(
        folder,
        tokens_file=tokens,
        token_keys_file=keys,
        access_check_s=PERIOD_S,
        token_leeway_s=0.0,
    ) as running:
        # Both files are looked at once more after the start; then only changes count.
        eventually(lambda: reloads(running, "tokens") and reloads(running, "token_keys"))
        yield running


def reloads(server: BackgroundServer, file: str, outcome: str = "ok") -> float:
    return float(server.service.metrics.key_reloads.labels(file, outcome)._value.get())


def withdrawn(server: BackgroundServer, reason: str) -> float:
    return float(server.service.metrics.withdrawn.labels(reason)._value.get())


def token(valid_s: float = 3600, **claims: object) -> str:
    fields = {"name": "anna", "scenes": frozenset({"pit"}), "token_id": "t1", **claims}
    return make_token(KEY, expires_s=int(time.time() + valid_s), **fields)  # type: ignore[arg-type]


def session(server: BackgroundServer, shown: str, scene_id: str = "pit") -> PlainClient:
    return PlainClient(
        server.scene_url(scene_id), additional_headers={"Authorization": f"Bearer {shown}"}
    )


def opens(server: BackgroundServer, shown: str, path: str = "/scenes/pit") -> int:
    headers = {"Authorization": f"Bearer {shown}"}
    return httpx.get(server.url + path, headers=headers).status_code


def test_each_way_to_show_a_signed_token_and_each_scene_by_itself(server: BackgroundServer) -> None:
    signed = token()
    assert opens(server, signed) == 200
    assert opens(server, signed, "/scenes/quarry") == 403
    assert opens(server, signed, "/scenes/quarry/base.tsg") == 403
    assert opens(server, signed, "/scenes/quarry/segments/0.glb") == 403
    listed = httpx.get(f"{server.url}/scenes", headers={"Authorization": f"Bearer {signed}"})
    assert [scene["id"] for scene in listed.json()["scenes"]] == ["pit"]
    with session(server, signed) as client:
        client.hello()
    with session(server, signed, "quarry") as client:
        assert client.refused()[1] == 4403
    with PlainClient(server.scene_url("pit")) as client:
        client.hello(token=signed)
    with PlainClient(server.scene_url("quarry")) as client:
        client.send_hello(token=signed)
        assert client.refused()[1] == 4403


def test_a_stranger_is_told_the_same_of_every_name(server: BackgroundServer) -> None:
    answers = []
    for scene_id in ("pit", "atlantis"):
        with PlainClient(server.scene_url(scene_id)) as client:
            client.send_hello(token="wrong")
            error, code = client.refused()
            answers.append((error.code, error.message, code))
        with PlainClient(server.scene_url(scene_id)) as client:
            client.land(1, (0.0, 0.0, 0.0), 1.0)
            answers.append(client.refused()[1])
    assert answers[0] == answers[2]
    with PlainClient(server.scene_url("atlantis")) as client:
        client.send_hello(token=ANNA)
        assert client.refused()[1] == 4404


def test_a_token_that_is_gone_closes_its_sessions_and_no_other(
    server: BackgroundServer, tokens: Path
) -> None:
    with session(server, ANNA) as anna, session(server, BOB) as bob:
        anna.hello(credit_bytes=1)
        bob.hello()
        anna.land(1, (0.0, 0.0, 0.0), 50.0)
        anna.expect(Plan)  # and in the middle of its payload
        tokens.write_text(f"bob {BOB} pit\n")
        began_s = time.monotonic()
        error, code = anna.refused()
        assert time.monotonic() - began_s < 3 * PERIOD_S + 2.0  # and what a busy machine adds
        assert (error.code, code) == ("unauthorised", 4401)
        assert "no longer opens this scene" in error.message
        bob.land(1, (0.0, 0.0, 0.0), 50.0)
        bob.until(Ready)
    assert withdrawn(server, "revoked") == 1
    assert opens(server, ANNA) == 401
    assert opens(server, BOB) == 200


def test_a_token_that_lost_a_scene_closes_that_scenes_sessions(
    server: BackgroundServer, tokens: Path
) -> None:
    with session(server, ANNA, "quarry") as lost, session(server, ANNA, "pit") as kept:
        lost.hello()
        kept.hello()
        tokens.write_text(f"anna {ANNA} pit\nbob {BOB} pit\n")
        assert lost.refused()[1] == 4401
        kept.land(1, (0.0, 0.0, 0.0), 50.0)
        kept.until(Ready)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"lonely\n", None])
def test_a_file_that_cannot_be_used_changes_nothing(
    server: BackgroundServer, tokens: Path, content: bytes | None
) -> None:
    with session(server, ANNA) as anna:
        anna.hello()
        if content is None:
            tokens.unlink()
        else:
            tokens.write_bytes(content)
        eventually(lambda: reloads(server, "tokens", "bad") == 1)
        time.sleep(4 * PERIOD_S)
        assert reloads(server, "tokens", "bad") == 1, "once per change"
        assert opens(server, ANNA) == 200
        anna.land(1, (0.0, 0.0, 0.0), 50.0)
        anna.until(Ready)
        tokens.write_text(f"carl {'c' * 16}\n")
        assert anna.refused()[1] == 4401
        assert opens(server, "c" * 16) == 200


def test_a_file_that_is_being_written_is_not_read(server: BackgroundServer, tokens: Path) -> None:
    """In place, slowly: half of it would lock anna out for a moment."""
    with session(server, ANNA) as anna:
        anna.hello()
        with tokens.open("w") as file:
            for number in range(15):
                file.write(f"guest{number} {'g' * 16}{number}\n")
                file.flush()
                time.sleep(PERIOD_S / 3)
            file.write(f"anna {ANNA}\n")
        eventually(lambda: opens(server, f"{'g' * 16}7") == 200)
        anna.land(1, (0.0, 0.0, 0.0), 50.0)
        anna.until(Ready)
    assert withdrawn(server, "revoked") == 0


def test_a_file_that_is_written_again_and_again_is_read(
    server: BackgroundServer, tokens: Path
) -> None:
    """By a job that goes wild, twenty times a second: nobody could be locked out any more."""
    with session(server, BOB) as bob:
        bob.hello()
        number = 0

        def is_out() -> bool:
            nonlocal number
            number += 1
            new = tokens.with_suffix(".new")
            new.write_text(f"# {number}\nanna {ANNA}\n")
            new.replace(tokens)
            return withdrawn(server, "revoked") == 1

        eventually(is_out)
        assert opens(server, ANNA) == 200
    assert opens(server, BOB) == 401


def test_keys_are_changed_without_cutting_anybody_off(server: BackgroundServer, keys: Path) -> None:
    newer = new_key("k2", "HS256")
    with session(server, token()) as client:
        client.hello()
        write_keys(keys, [newer.line(), KEY.line()])
        fresh = make_token(newer, name="bob", scenes=None, expires_s=int(time.time()) + 60)
        eventually(lambda: opens(server, fresh) == 200)
        assert opens(server, token()) == 200
        write_keys(keys, [newer.line()])
        assert client.refused()[1] == 4401
        assert opens(server, token()) == 401


def test_one_token_is_taken_back_before_its_time(server: BackgroundServer, keys: Path) -> None:
    with session(server, token()) as client, session(server, token(token_id="t2")) as other:
        client.hello()
        other.hello()
        write_keys(keys, [KEY.line(), "revoke t1"])
        assert client.refused()[1] == 4401
        other.land(1, (0.0, 0.0, 0.0), 50.0)
        other.until(Ready)


def test_an_expired_token_ends_its_session_while_it_streams(server: BackgroundServer) -> None:
    with session(server, token(valid_s=2.0)) as client:
        client.hello(credit_bytes=1)
        client.land(1, (0.0, 0.0, 0.0), 50.0)
        client.expect(Plan)
        error, code = client.refused()
        assert (error.code, code) == ("unauthorised", 4401)
        assert "has expired" in error.message
    assert withdrawn(server, "expired") == 1


def test_a_clock_that_jumps_moves_expiry_and_nothing_else(server: BackgroundServer) -> None:
    gate, real = server.service.gate, time.time
    with session(server, token()) as client, session(server, BOB) as bob:
        client.hello()
        bob.hello()
        gate._clock = lambda: real() - 86_400.0 * 365  # back a year: nobody is thrown out
        time.sleep(4 * PERIOD_S)
        for peer in (client, bob):
            peer.land(1, (0.0, 0.0, 0.0), 50.0)
            peer.until(Ready)
        gate._clock = lambda: real() + 86_400.0 * 365  # on a year: what has expired goes
        assert client.refused()[1] == 4401
        bob.land(2, (0.0, 0.0, 0.0), 50.0)
        bob.until(Ready)
    assert withdrawn(server, "expired") == 1


def write_certificate(folder: Path, name: str) -> None:
    """Write a self-signed certificate of this machine."""
    key = ec.generate_private_key(ec.SECP256R1())
    who = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = dt.datetime.now(tz=dt.UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(who)
        .issuer_name(who)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - dt.timedelta(days=1))
        .not_valid_after(now + dt.timedelta(days=1))
        .sign(key, hashes.SHA256())
    )
    pem = serialization.Encoding.PEM
    for path, data in (
        (
            "key.pem",
            key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()),
        ),
        ("cert.pem", certificate.public_bytes(pem)),
    ):
        (folder / f"new-{path}").write_bytes(data)
        (folder / f"new-{path}").replace(folder / path)


def served_name(server: BackgroundServer) -> str:
    """Return the name in the certificate that a new connection is shown."""
    pem = ssl.get_server_certificate(("127.0.0.1", server.port))
    subject = x509.load_pem_x509_certificate(pem.encode()).subject
    return str(subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)


def test_a_certificate_is_renewed_under_running_sessions(folder: Path, tmp_path: Path) -> None:
    write_certificate(tmp_path, "first")
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    with BackgroundServer(
        folder,
        ssl_certfile=tmp_path / "cert.pem",
        ssl_keyfile=tmp_path / "key.pem",
        access_check_s=PERIOD_S,
    ) as running:
        assert served_name(running) == "first"
        eventually(lambda: reloads(running, "tls"))
        url = running.scene_url("pit").replace("http://", "https://")
        with PlainClient(url, ssl=context) as client:
            client.hello()
            write_certificate(tmp_path, "second")
            eventually(lambda: served_name(running) == "second")
            (tmp_path / "key.pem").write_text("no key")
            eventually(lambda: reloads(running, "tls", "bad"))
            assert served_name(running) == "second"
            client.land(1, (0.0, 0.0, 0.0), 50.0)
            client.until(Ready)
        plain = PlainClient  # without TLS nothing answers
        with pytest.raises(Exception, match=r"(?i)http|line|closed|reset|response"):
            plain(running.scene_url("pit"))
