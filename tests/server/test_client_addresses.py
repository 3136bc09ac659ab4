"""Whose connections are counted, and how many."""

from __future__ import annotations

from terraport_server.client_addresses import (
    ARRIVALS_S,
    ClientAddresses,
    client_key,
    too_many_of_address,
)


def test_addresses_that_are_counted() -> None:
    addresses = ClientAddresses("127.0.0.1, 10.0.0.0/8, localhost")
    assert addresses.counted("127.0.0.1") is None
    assert addresses.counted("10.1.2.3") is None
    assert addresses.counted("192.0.2.1") == "192.0.2.1"
    assert addresses.counted("not an address") is None
    assert addresses.counted(None) is None
    assert ClientAddresses("*").counted("192.0.2.1") is None
    assert addresses.enter("192.0.2.1") == 1
    assert addresses.enter("192.0.2.1") == 2
    addresses.leave("192.0.2.1")
    assert addresses.enter("192.0.2.1") == 2
    for _ in range(2):
        addresses.leave("192.0.2.1")
    assert addresses.enter("192.0.2.1") == 1


def test_the_text_of_one_too_many() -> None:
    text = too_many_of_address(65, 64)
    assert text == "got connection 65 of one address, expected at most 64"


def test_arrivals_are_counted_for_a_while() -> None:
    """Whether or not they stay: who is counted out has arrived all the same."""
    addresses = ClientAddresses("")
    assert [addresses.arrive("192.0.2.1", 100.0 + second) for second in range(3)] == [1, 2, 3]
    assert addresses.arrive("192.0.2.2", 103.0) == 1
    assert addresses.arrive("192.0.2.1", 100.0 + ARRIVALS_S) == 1


def test_an_address_of_ipv6_is_one_of_many() -> None:
    """Whoever has one has 2^64; and one of IPv4 is the same however it is written."""
    addresses = ClientAddresses("2001:db8:1::/48, 192.0.2.9")
    assert addresses.counted("2001:db8::1") == addresses.counted("2001:db8::ffff:2")
    assert addresses.counted("2001:db8:0:1::1") != addresses.counted("2001:db8::1")
    assert addresses.counted("2001:db8:1::1") is None
    assert addresses.counted("::ffff:192.0.2.9") is None
    assert addresses.counted("::ffff:192.0.2.1") == "192.0.2.1"
    assert client_key("fe80::1%eth0") == "fe80::/64"
    assert client_key("unknown") == "unknown"


def test_who_came_in_vain_is_remembered_for_a_while() -> None:
    addresses = ClientAddresses("")
    addresses.came_in_vain("192.0.2.1", 100.0)
    addresses.came_in_vain("192.0.2.1", 101.0)
    assert addresses.in_vain("192.0.2.1", 102.0) == 2
    assert addresses.in_vain("192.0.2.2", 102.0) == 0
    assert addresses.in_vain("192.0.2.1", 100.0 + ARRIVALS_S) == 0
