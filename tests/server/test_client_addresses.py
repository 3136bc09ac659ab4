"""Whose connections are counted, and how many."""

from __future__ import annotations

from terraport_server.client_addresses import ARRIVALS_S, ClientAddresses, too_many_of_address


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
