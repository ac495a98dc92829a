"""Ctrl-C is held back while compiled code runs, and only then."""

import os
import signal
import threading
import weakref

import numpy as np
import pytest

from testbench import interrupts
from testbench.campaign import shard
from testbench.campaign.plan.measure import Variable
from testbench.storage import files, state_file


def strike():
    os.kill(os.getpid(), signal.SIGINT)


def block(strikes, done):
    """A block with that many strikes, then what it does."""
    with interrupts.defer_interrupts():
        for _ in range(strikes):
            strike()
        done.append(1)


def test_it_comes_at_the_end_of_the_block():
    done = []
    with pytest.raises(KeyboardInterrupt):
        block(1, done)
    assert done == [1]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_the_second_one_does_not_wait():
    done = []
    with pytest.raises(KeyboardInterrupt):
        block(2, done)
    assert done == []
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_nothing_happens_without_one_or_when_it_is_ignored():
    block(0, [])
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        block(1, [])
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_other_threads_may_run_engines():
    seen = []

    thread = threading.Thread(target=block, args=(0, seen))
    thread.start()
    thread.join()
    assert seen == [1]


def test_a_record_is_whole_or_absent_after_an_interrupt(tmp_path, monkeypatch):
    """At any write that the HDF5 library asks for."""
    plain = files.GuardedFile.write
    for nth in (1, 5, 9):
        left = [nth]

        def write(self, data, left=left):
            left[0] -= 1
            if left[0] == 0:
                strike()
            return plain(self, data)

        monkeypatch.setattr(files.GuardedFile, "write", write)
        path = tmp_path / f"{nth}.h5"
        with pytest.raises(KeyboardInterrupt):
            state_file.save_state(path, {"a": np.zeros(100_000)}, "layout")
        assert np.array_equal(state_file.load_state(path, "layout")[0]["a"], np.zeros(100_000))
    assert len(os.listdir(tmp_path)) == 3


def test_ctrl_c_while_a_point_is_read_is_not_swallowed(monkeypatch):
    """h5py forgets its objects in callbacks of weak references, where Python ignores exceptions."""
    data, plain = shard.encode('{"a": 1}', {"x": Variable((), 1.0, {})}), shard._variable

    def struck(*arguments):
        forgotten = threading.Event()
        watch = weakref.ref(forgotten, lambda _: strike())
        del forgotten
        assert watch() is None
        return plain(*arguments)

    monkeypatch.setattr(shard, "_variable", struck)
    with pytest.raises(KeyboardInterrupt):
        shard.decode(data, "point")
