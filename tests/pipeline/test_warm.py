"""Kernels that are compiled beside the demo."""

from __future__ import annotations

import os
import subprocess
import sys

import numba
import pytest

from terraport_pipeline import warm
from terraport_pipeline.warm import kernel_of, read_kernels, type_of, warming


def test_the_list_names_kernels_with_as_many_arguments_as_they_take() -> None:
    kernels = read_kernels()
    assert len(kernels) == len({(name, *types) for name, types in kernels}) > 100
    for name, types in kernels:
        kernel, names = kernel_of(name)
        assert len(kernel.py_func.__annotations__) == len(types) + 1, name
        assert all(isinstance(type_of(text, names), numba.types.Type) for text in types)


@pytest.mark.parametrize("text", ["", "f8:", "f8:2w", "Grid(f8"])
def test_what_is_no_type_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="expected a type"):
        type_of(text, {})


def test_a_list_older_than_the_kernels_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel that is gone, one with other arguments; the kernel before both is still compiled."""
    compiled: list[str] = []

    class Kernel:
        def __init__(self, name: str) -> None:
            self.name = name
            self.stats = type("stats", (), {"cache_hits": {}})

        def compile(self, types: tuple[object, ...]) -> None:
            if not types:
                raise TypeError
            compiled.append(self.name)

    def find(name: str) -> tuple[Kernel, dict[str, object]]:
        if name == "gone":
            raise KeyError(name)
        return Kernel(name), {}

    monkeypatch.setattr(warm, "kernel_of", find)
    warm.warm([("first", ["f8"]), ("changed", []), ("gone", ["f8"]), ("last", ["i8:1"])])
    assert compiled == ["last", "first"]


def test_a_filled_cache_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    class Kernel:
        stats = type("stats", (), {"cache_hits": {(): 1}})

        def compile(self, types: tuple[object, ...]) -> None:
            del types

    def find(name: str) -> tuple[Kernel, dict[str, object]]:
        asked.append(name)
        return Kernel(), {}

    monkeypatch.setattr(warm, "kernel_of", find)
    warm.warm([("first", []), ("last", [])])
    assert asked == ["last"]


@pytest.mark.parametrize(("cores", "children"), [(1, 0), (2, 1)])
def test_one_child_beside_the_block_where_a_core_is_left(
    monkeypatch: pytest.MonkeyPatch, cores: int, children: int
) -> None:
    started: list[subprocess.Popen[bytes]] = []

    def start(command: list[str], **options: object) -> subprocess.Popen[bytes]:
        assert command[:3] == [sys.executable, "-m", "terraport_pipeline.warm"]
        assert set(options.values()) == {subprocess.DEVNULL}
        child = real([sys.executable, "-c", "import time; time.sleep(60)"])
        started.append(child)
        return child

    real = subprocess.Popen
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(cores)), raising=False)
    monkeypatch.setattr(subprocess, "Popen", start)
    with warming():
        assert all(child.poll() is None for child in started)
    assert len(started) == children
    assert all(child.returncode is not None for child in started)
