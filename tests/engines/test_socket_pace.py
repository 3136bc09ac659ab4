"""A landing in Unreal at the pace of the engine's socket thread, counted in rounds and frames.

The thread is not run: the visit's network looks at the socket as often as the engine's thread would
at the pace that the engine's module read when it was loaded. Frames are 5 ms.
"""

from __future__ import annotations

from typing import Any, Final

import pytest
from engines import cores
from engines.programs import socket_pace
from faults.service import Service

RADIUS_M: Final = 8
FULL_RADIUS_M: Final = 25
"""A landing of 8 MB: what greets, asks and plans takes a few rounds of whatever size."""

FRAME_S: Final = 0.005
ROUND_BYTES: Final = 32 * 1024
"""What one round takes from a socket at most: the buffer that the engine gives libwebsockets."""

ENGINES_S: Final = 0.0333
MAX_RATIO: Final = 1.15
"""Time from the call to ready, over what the bytes alone need."""


@pytest.fixture(scope="module")
def early(cpp: cores.CppCore, server: Service) -> dict[str, Any]:
    """The plugin starts before anybody has loaded the engine's module."""
    return socket_pace(cpp, f"{server.url}/scenes/bigger", RADIUS_M)


@pytest.fixture(scope="module")
def late(cpp: cores.CppCore, server: Service) -> dict[str, Any]:
    """Something else has loaded it before."""
    return socket_pace(cpp, f"{server.url}/scenes/bigger", RADIUS_M, late=True)


def test_the_plugin_sets_the_pace_before_the_module_is_loaded(early: dict[str, Any]) -> None:
    assert early["frame_time_s"] == 0.001
    assert early["warnings"] == 0
    # Five a frame; a loaded machine misses some. At the engine's own pace it is one in six frames.
    assert early["rounds"] >= 2 * early["frames"]


def test_loaded_before_the_engines_pace_stays_and_the_log_says_so(late: dict[str, Any]) -> None:
    assert late["frame_time_s"] == ENGINES_S
    assert late["warnings"] == 1


def test_at_the_engines_pace_the_rounds_are_what_takes_the_time(
    early: dict[str, Any], late: dict[str, Any]
) -> None:
    """A landing needs so many rounds; each was six frames and is now a fifth of one."""
    needed = early["payload_bytes"] / ROUND_BYTES
    assert needed > 30
    assert late["rounds"] >= needed
    assert late["frames"] * FRAME_S >= (needed - 1) * ENGINES_S
    assert early["frames"] * 4 < late["frames"]


@pytest.mark.parametrize("buffer_kib", [4, 32, 64, 128])
def test_nothing_but_the_bytes_is_waited_for(
    cpp: cores.CppCore, server: Service, buffer_kib: int
) -> None:
    """Asking, planning and acknowledging cost next to no rounds, however small or large."""
    url = f"{server.url}/scenes/bigger"
    pace = socket_pace(cpp, url, FULL_RADIUS_M, late=True, buffer_bytes=buffer_kib * 1024)
    assert pace["payload_bytes"] > 8e6
    needed_s = pace["payload_bytes"] / (buffer_kib * 1024) * ENGINES_S
    assert 1 <= pace["frames"] * FRAME_S / needed_s <= MAX_RATIO, pace
