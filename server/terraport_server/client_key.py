"""Key of a client for limits per address: its IPv4 address, or its IPv6 /64 network."""

from __future__ import annotations

import ipaddress

__all__ = ["client_key"]


def client_key(host: str) -> str:
    """Return the key under which a client's sessions are counted.

    A client with one IPv6 address usually has all 2^64 of its network.

    Examples
    --------
    >>> client_key("2001:db8::17"), client_key("::ffff:192.0.2.1"), client_key("somewhere")
    ('2001:db8::/64', '192.0.2.1', 'somewhere')
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv6Address):
        if address.ipv4_mapped is None:
            return f"{ipaddress.IPv6Address(int(address) >> 64 << 64)}/64"
        address = address.ipv4_mapped
    return str(address)
