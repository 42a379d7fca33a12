"""Tasks for processes that may die of them; of a module, so that they travel."""

import os
import signal
import time

import numpy as np

MB = 10**6


def prepared():
    return {"number": os.getpid()}


def unprepared():
    raise ValueError("nothing to prepare")


def pid(state):
    assert state["number"] == os.getpid()
    return os.getpid()


def allocate(state, megabytes):
    return len(np.ones(megabytes * MB // 8))


def die(state, how):
    if how == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    os.write(2, how.encode())
    os.abort()


def leave(state, code):
    os._exit(code)


def wait(state, seconds):
    time.sleep(seconds)


def fail(state):
    raise KeyError("key")


def no_pickle(state):
    return lambda: None
