"""Signed tokens: what is accepted, and the many things that are not."""

from __future__ import annotations

import base64
import json
from typing import Any

import jwt
import pytest

from terraport_server.auth.gate import Gate, TokenPass
from terraport_server.auth.keys import KeyRing, TokenKey, new_key
from terraport_server.auth.tokens import decode_unverified, make_token, read_token
from terraport_wire import ErrorCode

KEY = TokenKey("k1", "HS256", bytes(range(32)))
OLD = TokenKey("k0", "HS256", bytes(range(1, 33)))
ED = new_key("e1", "EdDSA")
RING = KeyRing((KEY, OLD, ED.public()), frozenset({"taken-back"}))
NOW_S = 1_800_000_000.0
CLAIMS: dict[str, Any] = {"sub": "anna", "exp": int(NOW_S) + 60, "scenes": ["pit"]}


def gate(now_s: float = NOW_S, **options: Any) -> Gate:
    return Gate(None, RING, clock=lambda: now_s, **options)


def signed(
    claims: dict[str, Any], *, key: TokenKey = KEY, kid: str | None = None, **headers: Any
) -> str:
    names = {"kid": kid or key.id, **headers}
    return jwt.encode(claims, key.signing(), algorithm=key.jwt_algorithm, headers=names)


def base64url(data: bytes) -> str:
    return base64.urlsafe_b64encode(data).rstrip(b"=").decode()


@pytest.mark.parametrize("key", [KEY, OLD, ED], ids=["first", "rotated", "EdDSA"])
def test_a_token_of_every_key(key: TokenKey) -> None:
    token = make_token(key, name="anna", scenes=frozenset({"pit"}), expires_s=int(NOW_S) + 60)
    token_pass = gate().find(token)
    assert token_pass is not None
    assert (token_pass.name, token_pass.scenes, token_pass.guide) == (
        "anna",
        frozenset({"pit"}),
        False,
    )
    assert gate().check(token, "pit") is None
    assert gate().check(token, "quarry") is ErrorCode.FORBIDDEN


def test_every_scene_must_be_said() -> None:
    assert gate().check(signed(CLAIMS | {"scenes": "*"}), "any") is None
    assert gate().check(signed(CLAIMS | {"scenes": []}), "any") is ErrorCode.FORBIDDEN


@pytest.mark.parametrize(
    ("scope", "guides"),
    [("guide", True), ("openid guide metrics", True), ("land", False), (["guide"], False)],
)
def test_guides(scope: object, guides: bool) -> None:
    found = gate().find(signed(CLAIMS | {"scope": scope}))
    assert (found is not None and found.guide) == guides


@pytest.mark.parametrize(
    "claims",
    [
        {name: value for name, value in CLAIMS.items() if name != "exp"},
        {name: value for name, value in CLAIMS.items() if name != "sub"},
        {name: value for name, value in CLAIMS.items() if name != "scenes"},
        CLAIMS | {"exp": "tomorrow"},
        CLAIMS | {"exp": True},
        CLAIMS | {"exp": None},
        CLAIMS | {"nbf": "now"},
        CLAIMS | {"sub": 7},
        CLAIMS | {"sub": ""},
        CLAIMS | {"sub": "a" * 65},
        CLAIMS | {"sub": "two\nlines"},
        CLAIMS | {"scenes": "pit"},
        CLAIMS | {"scenes": [1]},
        CLAIMS | {"scenes": {"pit": 1}},
        CLAIMS | {"jti": 5},
        CLAIMS | {"jti": "taken-back"},
        CLAIMS | {"aud": "somebody else"},
    ],
    ids=lambda claims: json.dumps(claims)[:60],
)
def test_claims_that_are_not_taken(claims: dict[str, Any]) -> None:
    assert gate().find(signed(claims)) is None


@pytest.mark.parametrize(
    ("now_s", "opens"),
    [(NOW_S + 59, True), (NOW_S + 60, True), (NOW_S + 89, True), (NOW_S + 90, False)],
)
def test_expiry_with_leeway(now_s: float, opens: bool) -> None:
    assert (gate(now_s, leeway_s=30.0).find(signed(CLAIMS)) is not None) is opens


@pytest.mark.parametrize(("now_s", "opens"), [(NOW_S - 31, False), (NOW_S - 30, True)])
def test_not_before_with_leeway(now_s: float, opens: bool) -> None:
    token = signed(CLAIMS | {"nbf": int(NOW_S)})
    assert (gate(now_s, leeway_s=30.0).find(token) is not None) is opens


def test_audience() -> None:
    token = signed(CLAIMS | {"aud": "terraport-pit"})
    assert gate(audience="terraport-pit").find(token) is not None
    assert gate(audience="another").find(token) is None
    assert gate(audience="terraport-pit").find(signed(CLAIMS)) is None
    assert gate(audience="a").find(signed(CLAIMS | {"aud": ["a", "b"]})) is None


def forged() -> list[str]:
    """Tokens of somebody without a key."""
    head, body, signature = signed(CLAIMS).split(".")
    none = base64url(json.dumps({"alg": "none", "kid": "k1"}).encode())
    longer = base64url(json.dumps(CLAIMS | {"scenes": "*"}).encode())
    public = ED.public().verifying()
    # The public key's bytes as an HMAC secret: the classic confusion of algorithms.
    import hashlib
    import hmac

    confused_head = base64url(json.dumps({"alg": "HS256", "kid": "e1"}).encode())
    mac = hmac.new(public.public_bytes_raw(), f"{confused_head}.{body}".encode(), hashlib.sha256)
    nested = base64url(b"[" * 3000)
    return [
        f"{none}.{body}.",
        f"{none}.{body}.{signature}",
        f"{head}.{longer}.{signature}",
        f"{head}.{body}.",
        f"{head}.{body}.{signature[:-2]}",
        f"{head}.{body}.{signature}.x",
        f"{confused_head}.{body}.{base64url(mac.digest())}",
        signed(CLAIMS, kid="k0"),
        signed(CLAIMS, kid="unknown"),
        signed(CLAIMS, key=ED, kid="k1"),
        jwt.encode(CLAIMS, KEY.secret, algorithm="HS256"),  # no kid
        jwt.encode(CLAIMS, KEY.secret, algorithm="HS256", headers={"kid": "../../etc/passwd"}),
        jwt.encode(CLAIMS, KEY.secret + bytes(32), algorithm="HS512", headers={"kid": "k1"}),
        f"{nested}.{nested}.{nested}",
        "..",
        "a.b.c",
        "é.é.é",
        "." * 4096,
        base64url(b'{"kid":"k1","alg":"HS256","crit":["x"]}') + f".{body}.{signature}",
    ]


@pytest.mark.parametrize("token", forged(), ids=range(len(forged())))
def test_forged_tokens(token: str) -> None:
    assert gate().find(token) is None
    assert read_token(token, RING, audience=None) is None


def test_every_changed_character_is_noticed() -> None:
    token = signed(CLAIMS)
    checking = gate()
    for index in range(0, len(token), 3):
        other = "A" if token[index] != "A" else "B"
        changed = token[:index] + other + token[index + 1 :]
        token_pass = checking.find(changed)
        # Base64's last character has bits that mean nothing.
        assert token_pass is None or index == len(token) - 1


def test_a_pass_goes_with_its_key_its_id_and_its_time() -> None:
    def passed(checking: Gate) -> TokenPass:
        token_pass = checking.admit(signed(CLAIMS | {"jti": "t1"}), "pit")
        assert isinstance(token_pass, TokenPass)
        return token_pass

    checking = gate(leeway_s=30.0)
    shown = passed(checking)
    assert checking.withdrawal(shown, "pit") is None
    checking.use_keys(KeyRing((OLD, KEY), frozenset()))
    assert checking.withdrawal(shown, "pit") is None
    checking.use_keys(KeyRing((OLD, KEY), frozenset({"t1"})))
    assert checking.withdrawal(shown, "pit") == "revoked"
    checking.use_keys(KeyRing((OLD,), frozenset()))
    assert checking.withdrawal(shown, "pit") == "revoked"
    other = TokenKey("k1", "HS256", bytes(32))
    checking.use_keys(KeyRing((other,), frozenset()))
    assert checking.withdrawal(shown, "pit") == "revoked", "another key of the same name"


def test_what_a_token_says_can_be_looked_at() -> None:
    decoded = decode_unverified(signed(CLAIMS))
    assert decoded is not None
    assert decoded[0]["kid"] == "k1"
    assert decoded[1] == CLAIMS
    assert decode_unverified("no token") is None
