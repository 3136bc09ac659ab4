"""Processes that see what a container would: own network, names, root, user and capabilities.

No container engine runs where this project is developed. What compose.yaml promises to a process is
made of namespaces all the same, and Linux hands those out to root: a network namespace per
container on a bridge, a DNS server that knows the services by name, a root that is read-only but
for its volumes, a user without rights. The programs are this machine's.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import os
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

__all__ = ["Container", "Network"]

_SYSTEM = ("usr", "bin", "sbin", "lib", "lib32", "lib64", "libx32")
_ETC = ("passwd", "group", "nsswitch.conf", "ld.so.cache", "ssl", "mime.types", "alternatives")


def _run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True, text=True)


class Network:
    """A bridge with a subnet, and a DNS server on its first address. A context manager."""

    def __init__(self, subnet: str, folder: Path) -> None:
        hosts = ipaddress.ip_network(subnet).hosts()
        self.gateway = str(next(hosts))
        self.prefix = ipaddress.ip_network(subnet).prefixlen
        self.folder = folder
        self.names: dict[str, list[str]] = {}
        """Addresses by name, as the DNS server answers: of containers that run, as an engine's."""
        self._addresses = hosts
        self._bridge = f"tp{os.getpid() % 1_000_000}"
        self._count = 0
        self._containers: list[Container] = []
        self._dns = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def __enter__(self) -> Self:
        _run("ip", "link", "add", self._bridge, "type", "bridge")
        _run("ip", "addr", "add", f"{self.gateway}/{self.prefix}", "dev", self._bridge)
        _run("ip", "link", "set", self._bridge, "up")
        self._dns.bind((self.gateway, 53))
        threading.Thread(target=self._answer, name="dns", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        for container in self._containers:
            container.remove()
        self._dns.close()
        with contextlib.suppress(subprocess.CalledProcessError):
            _run("ip", "link", "del", self._bridge)

    def attach(self, container: Container) -> tuple[str, str]:
        """Give a container a network namespace and an address; return both."""
        self._count += 1
        space, address = f"{self._bridge}n{self._count}", str(next(self._addresses))
        host_end, container_end = f"{self._bridge}h{self._count}", "eth0"
        _run("ip", "netns", "add", space)
        inside = ("ip", "netns", "exec", space)
        _run(
            "ip",
            "link",
            "add",
            host_end,
            "type",
            "veth",
            "peer",
            "name",
            container_end,
            "netns",
            space,
        )
        _run("ip", "link", "set", host_end, "master", self._bridge, "up")
        _run(*inside, "ip", "addr", "add", f"{address}/{self.prefix}", "dev", container_end)
        for device in (container_end, "lo"):
            _run(*inside, "ip", "link", "set", device, "up")
        _run(*inside, "ip", "route", "add", "default", "via", self.gateway)
        # As a container engine sets it: ports below 1024 are free for all inside.
        _run(*inside, "sysctl", "-q", "-w", "net.ipv4.ip_unprivileged_port_start=0")
        self._containers.append(container)
        return space, address

    def _answer(self) -> None:
        """Answer A queries by `names`, anything else with nothing, until closed."""
        while True:
            try:
                query, peer = self._dns.recvfrom(512)
            except OSError:
                return
            with contextlib.suppress(IndexError, UnicodeDecodeError):
                labels, offset = [], 12
                while query[offset]:
                    labels.append(query[offset + 1 : offset + 1 + query[offset]].decode())
                    offset += 1 + query[offset]
                kind = int.from_bytes(query[offset + 1 : offset + 3], "big")
                resolved = self.names.get(".".join(labels).lower().rstrip("."))
                addresses = resolved or [] if kind == 1 else []
                flags = 0x8180 if resolved is not None else 0x8183
                answer = query[:2] + struct.pack(">HHHHH", flags, 1, len(addresses), 0, 0)
                answer += query[12 : offset + 5]
                for address in addresses:
                    answer += b"\xc0\x0c" + struct.pack(">HHIH", 1, 1, 1, 4)
                    answer += socket.inet_aton(address)
                self._dns.sendto(answer, peer)


@dataclass(eq=False)
class Container:
    """One process and its surroundings."""

    network: Network
    name: str
    command: list[str]
    environment: dict[str, str]
    user: int
    mounts: list[tuple[Path, str, bool]] = field(default_factory=list)
    """(on the host, inside, read-only)."""
    tmpfs: list[str] = field(default_factory=list)
    aliases: list[str] = field(default_factory=list)
    read_only: bool = True
    process: subprocess.Popen[bytes] | None = None

    def __post_init__(self) -> None:
        self.space, self.address = self.network.attach(self)
        self.log_path = self.network.folder / f"{self.name}.log"
        self._root = self.network.folder / f"{self.name}.root"
        for alias in (self.name, *self.aliases):
            self.network.names.setdefault(alias, [])

    @property
    def log(self) -> str:
        """Everything that it has said, over all of its starts."""
        return self.log_path.read_text() if self.log_path.exists() else ""

    def start(self) -> None:
        """Start the command, again if it has ended."""
        for alias in (self.name, *self.aliases):
            self.network.names[alias].append(self.address)
        with self.log_path.open("ab") as log:
            self.process = subprocess.Popen(
                self._inside(self.command), stdout=log, stderr=log, stdin=subprocess.DEVNULL
            )

    def run(self, command: list[str]) -> subprocess.CompletedProcess[str]:
        """Run one more command in the same surroundings."""
        return subprocess.run(
            self._inside(command), capture_output=True, text=True, timeout=30, check=False
        )

    def end(self, number: int = signal.SIGTERM) -> int | None:
        """Send a signal and wait; return the exit code."""
        if self.process is None:
            return None
        self.process.send_signal(number)
        try:
            code = self.process.wait(40)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        for alias in (self.name, *self.aliases):
            if self.address in self.network.names[alias]:
                self.network.names[alias].remove(self.address)
        return code

    def remove(self) -> None:
        """End it and give its namespace back."""
        if self.process is not None and self.process.poll() is None:
            self.end(signal.SIGKILL)
        with contextlib.suppress(subprocess.CalledProcessError):
            _run("ip", "netns", "del", self.space)
        shutil.rmtree(self._root, ignore_errors=True)

    def _inside(self, command: list[str]) -> list[str]:
        """Wrap a command: namespaces, a root of its own, then the user."""
        root = self._root
        root.mkdir(exist_ok=True)
        lines = ["set -e", "umask 022", f"mount -t tmpfs -o mode=755 tmpfs {root}", f"cd {root}"]
        for name in _SYSTEM:
            path = Path("/", name)
            if path.is_symlink():
                lines.append(f"ln -s {path.readlink()} {name}")
            elif path.is_dir():
                lines.append(f"mkdir {name}; mount --rbind /{name} {name}")
        lines.append("mkdir etc proc dev tmp; mount --rbind /proc proc; mount --rbind /dev dev")
        lines.extend(f"cp -a /etc/{name} etc/" for name in _ETC if Path("/etc", name).exists())
        lines.append(f"echo nameserver {self.network.gateway} > etc/resolv.conf")
        lines.append("echo options ndots:0 >> etc/resolv.conf")
        lines.append(
            f"echo 127.0.0.1 localhost > etc/hosts; echo {self.address} {self.name} >> etc/hosts"
        )
        # Before what is mounted: a checkout may itself lie in /tmp.
        for entry in self.tmpfs:
            path, _, options = entry.partition(":")
            mount_options = f"mode=1777,{options}" if options else "mode=1777"
            lines.append(f"mkdir -p .{path}; mount -t tmpfs -o {mount_options} tmpfs .{path}")
        # The interpreter of this very run, and what it imports, where they lie on the host.
        # Resolved: a link within the checkout would be followed to the host's own folder.
        folders = (Path(sys.base_prefix), Path(sys.prefix), Path(__file__).parents[1])
        programs = {part for folder in folders for part in _readable(folder.resolve())}
        mounts = [(path, str(path), True) for path in sorted(programs)] + self.mounts
        for source, target, read_only in mounts:
            if source.is_dir():
                lines.append(f"mkdir -p .{target}")
            else:
                lines.append(f"mkdir -p .{Path(target).parent}; touch .{target}")
            lines.append(f"mount --bind {source} .{target}")
            if read_only:
                lines.append(f"mount -o remount,bind,ro .{target}")
        if self.read_only:
            lines.append("mount -o remount,ro .")
        variables = " ".join(f"'{name}={value}'" for name, value in self.environment.items())
        rights = f"--reuid {self.user} --regid {self.user} --clear-groups --no-new-privs"
        words = " ".join("'" + word.replace("'", "'\\''") + "'" for word in command)
        lines.append(
            f"exec chroot . setpriv {rights} --inh-caps=-all --bounding-set=-all "
            f"env -i -C /tmp {variables} {words}"
        )
        spaces = ["unshare", "--mount", "--propagation", "private"]
        return ["ip", "netns", "exec", self.space, *spaces, "sh", "-c", "\n".join(lines)]


def _readable(folder: Path) -> list[Path]:
    """Return a folder, or those in it where it is its owner's alone, as mkdtemp makes it.

    Who runs in a container is another user, and could not enter.
    """
    if folder.stat().st_mode & 0o005 == 0o005:
        return [folder]
    parts = (part for part in folder.iterdir() if not part.name.startswith("."))
    return [part for part in parts if part.is_dir() and not part.is_symlink()]


async def published(container: Container, port: int) -> asyncio.Server:
    """Hand a free port of this machine's loopback on to a container's, as `ports:` does."""

    async def copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(1 << 16):
                writer.write(data)
                await writer.drain()
        writer.close()

    async def relay(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            to_reader, to_writer = await asyncio.open_connection(container.address, port)
        except OSError:
            writer.close()
            return
        await asyncio.gather(copy(reader, to_writer), copy(to_reader, writer))

    return await asyncio.start_server(relay, "127.0.0.1", 0)
