"""Under which number other machines reach this one."""

from __future__ import annotations

from collections.abc import Sequence

from wdpm.cluster.transport import address

LOOPBACK = "127.0.0.1"


def address_towards(hosts: Sequence[str]) -> str:
    """This machine's number on the way to the first of some machines that is not this one; loopback if all are.

    A machine's own name will not do: Debian, among others, has it mean 127.0.1.1.

    Args:
        hosts: names or numbers.

    Raises:
        SettingsError: one of them cannot be found, or no network reaches it.
    """
    for host in hosts:
        number = address.interface_towards(address.resolve(address.join(host, 1)))
        if not address.is_loopback(address.join(number, 1)):
            return number
    return LOOPBACK


def listening_address(number: str) -> str:
    """Where a master listens that slaves reach under a number: a free port, of all interfaces or of loopback alone."""
    return address.join(LOOPBACK if number == LOOPBACK else "*", 0)


def reached_at(number: str, endpoint: str) -> str:
    """The address by which slaves reach a master under a number.

    Args:
        endpoint: where it listens.
    """
    return address.join(number, address.split(endpoint)[1])
