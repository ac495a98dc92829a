"""Warm-up: only an empty cache starts children, and a child that fails costs time, not the run."""

import sys

import pytest

from testbench.engines import engine, frame
from testbench.run import warmup


@pytest.fixture
def children(monkeypatch, tmp_path):
    """Commands of the children that would be started; the cache is an empty folder."""
    started = []

    class Child:
        def __init__(self, command, **options):
            started.append(command)

        def wait(self, timeout):
            return 1

        def kill(self):
            pass

    monkeypatch.setattr(warmup.subprocess, "Popen", Child)
    monkeypatch.setattr(warmup, "CACHE", True)
    monkeypatch.setattr(warmup.os, "cpu_count", lambda: 2)
    monkeypatch.setattr(warmup, "cache_folder", lambda _: tmp_path)
    return started


def test_an_empty_cache_is_filled_by_two_children(children):
    warmup.warm_up()
    assert [command[0] for command in children] == [sys.executable] * 2
    assert [command[-1].split("_")[-1] for command in children] == ["ticks()", "blocks()"]
    for command in children:
        assert hasattr(warmup, command[-1].split(".")[-1].removesuffix("()"))


@pytest.mark.parametrize("function", [engine.run_ticks, frame.blocks])
def test_a_filled_cache_needs_none(children, tmp_path, function):
    name = f"{function.__module__.split('.')[-1]}.{function.__name__}-12.py311.nbi"
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / name).touch()
    warmup.warm_up()
    assert children == []


def test_one_core_or_no_cache_needs_none(children, monkeypatch):
    monkeypatch.setattr(warmup.os, "cpu_count", lambda: 1)
    warmup.warm_up()
    monkeypatch.setattr(warmup.os, "cpu_count", lambda: 8)
    monkeypatch.setattr(warmup, "CACHE", False)
    warmup.warm_up()
    assert children == []
