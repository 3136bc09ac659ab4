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
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

from commands import say
from configuration import check_alertmanager, check_files, compose_config
from deployment import check_services
from dockerfile import read_stages
from services import services, why_no_services

HERE: Final = Path(__file__).resolve().parent
GATEWAY: Final = "172.30.83.1"
"""First address of compose.yaml's network; the receiver of alerts listens there."""


def main() -> int:
    """Run every check that can run here."""
    sys.path.insert(0, str(HERE.parent / "tests"))
    from server.grid_scene import write_grid_scene

    stages, _ = read_stages(HERE / "Dockerfile")
    with tempfile.TemporaryDirectory(prefix="terraport-verify-") as folder:
        work = Path(folder)
        work.chmod(0o755)
        write_grid_scene(work / "scenes" / "big", cells=80, name="big")
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


if __name__ == "__main__":
    sys.exit(main())
