"""The services of compose.yaml as containers (containers.py): made, started, asked."""

from __future__ import annotations

import asyncio
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import httpx
from configuration import token_of
from containers import Container, Network
from dockerfile import Stage

ROOT: Final = Path(__file__).resolve().parents[1]
OTHERS: Final = {
    "prometheus": ("prometheus", 65534),
    "alertmanager": ("prometheus-alertmanager", 65534),
    "s3": ("weed", 0),
}
"""Program and user of other people's images."""
STAGES: Final = {"server": "server", "server-s3": "server", "proxy": "web", "upload": "pipeline"}


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
            # The user in the Compose file overrides the image's.
            user = int(str(spec.get("user") or stage.last("USER") or 0).partition(":")[0])
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


def query(running: Services, expression: str) -> list[str]:
    """Values that Prometheus has for an expression now."""
    address = f"http://{running.prometheus.address}:9090/api/v1/query"
    answer = httpx.get(address, params={"query": expression}).json()
    assert answer["status"] == "success", f"{expression}: {answer}"
    return [sample["value"][1] for sample in answer["data"]["result"]]


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
