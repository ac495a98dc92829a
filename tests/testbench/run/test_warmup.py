"""Warm-up: only an empty cache starts children, and a child that fails costs time, not the run."""

import sys
from typing import ClassVar

import pytest

from fpga_model import shared_files
from testbench.engines import engine, frame
from testbench.run import warmup


class Child:
    """A process that ends when it is told to."""

    started: ClassVar = []

    def __init__(self, command, **options):
        self.started.append(command)
        self.running = True

    def poll(self):
        return None if self.running else 1

    def wait(self, timeout=None):
        self.running = False
        return 1

    def kill(self):
        pass


def release_turn():
    if warmup._turn.cache_info().currsize and not isinstance(turn := warmup._turn(), shared_files.LockedError):
        turn.close()
    warmup._turn.cache_clear()


@pytest.fixture
def children(monkeypatch, tmp_path):
    """Commands of the children that would be started; the cache is empty."""
    # an earlier test may have had a child and the turn
    if warmup._frame_child.cache_info().currsize:
        warmup._frame_child().wait()
    release_turn()
    warmup._frame_child.cache_clear()
    monkeypatch.setattr(warmup, "cache_root", lambda: tmp_path)
    monkeypatch.setattr(Child, "started", [])
    monkeypatch.setattr(warmup.subprocess, "Popen", Child)
    monkeypatch.setattr(warmup, "CACHE", True)
    monkeypatch.setattr(warmup.os, "cpu_count", lambda: 2)
    monkeypatch.setattr(warmup, "is_cached", lambda _: False)
    yield Child.started
    release_turn()


def test_an_empty_cache_is_filled_by_children(children):
    warmup.warm_up("lanes")
    assert [command[0] for command in children] == [sys.executable] * 3
    assert [command[-1].split("_")[-1] for command in children] == ["frame()", "clocked()", "lanes()"]
    for command in children:
        assert hasattr(warmup, command[-1].split(".")[-1].removesuffix("()"))


def test_the_clocked_engine_stands_in_until_the_frame_engine_is_compiled(children, monkeypatch):
    monkeypatch.setattr(warmup.clocked, "run", lambda *chunk: ("clocked", chunk))
    monkeypatch.setattr(frame, "run", lambda *chunk: ("frame", chunk))
    run = warmup.frame_run()
    assert len(children) == 1
    assert run(1, 2) == ("clocked", (1, 2))
    run.child.running = False
    assert run(3) == ("frame", (3,))


def test_of_two_processes_on_an_empty_cache_one_stands_in_and_the_other_waits(children, monkeypatch, tmp_path):
    monkeypatch.setattr(warmup.clocked, "run", lambda *chunk: pytest.fail("two processes stand in"))
    monkeypatch.setattr(frame, "run", lambda *chunk: ("frame", chunk))
    with shared_files.try_lock(tmp_path / "standby.lock"):
        run = warmup.frame_run()
        assert run(1, 2) == ("frame", (1, 2))
        assert not run.child.running


def test_one_can_wait_for_the_frame_engine(children):
    warmup.wait()
    assert children == []
    run = warmup.frame_run()
    warmup.wait()
    assert not run.child.running


def test_a_filled_cache_needs_none(children, monkeypatch):
    monkeypatch.setattr(warmup, "is_cached", lambda dispatcher: dispatcher is frame.run_blocks)
    warmup.warm_up()
    assert warmup.frame_run() is frame.run
    assert children == []


def test_one_core_or_no_cache_needs_none(children, monkeypatch):
    monkeypatch.setattr(warmup.os, "cpu_count", lambda: 1)
    warmup.warm_up()
    assert warmup.frame_run() is frame.run
    monkeypatch.setattr(warmup.os, "cpu_count", lambda: 8)
    monkeypatch.setattr(warmup, "CACHE", False)
    warmup.warm_up()
    assert warmup.frame_run() is frame.run
    assert children == []


def test_what_the_children_compile_is_what_runs_call():
    assert warmup.clocked is engine
    for part in ("clocked", "frame", "lanes", "baseband"):
        assert callable(getattr(warmup, f"compile_{part}"))
