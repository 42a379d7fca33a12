"""Estimators that take too much, crash or fail on purpose; of a module, so that they travel to other processes."""

import ctypes
import os
import signal
import time

import numpy as np

from nonsac.problems import Registration


def honest(rows, threshold, seed):
    """A quick right answer for pairs: the best of many models of three pairs."""
    samples = rows[np.random.default_rng(seed).integers(len(rows), size=(400, 3))]
    models = Registration().solve_minimal(samples)
    return models[np.argmax((Registration().residuals(models, rows) < threshold).sum(axis=1))]


def greedy(rows, threshold, seed):
    return np.ones(2**33).reshape(3, 4, -1)[..., 0]


def greedy_outside(rows, threshold, seed):
    """As a library of C++ ends that is refused memory."""
    os.write(2, b"terminate called after throwing an instance of 'std::bad_alloc'\n")
    os.abort()


def sleepy(rows, threshold, seed):
    time.sleep(60.0)


def slow_on_many(rows, threshold, seed):
    """Says how many rows it is slow on, in a file that the environment names."""
    if len(rows) > 300:
        with open(os.environ["SLOW_ON"], "a") as file:
            file.write(f"{len(rows)}\n")
        time.sleep(60.0)
    return honest(rows, threshold, seed)


def crashing(rows, threshold, seed):
    os.kill(os.getpid(), signal.SIGSEGV)


def reading_nowhere(rows, threshold, seed):
    ctypes.string_at(0)


def leaving(rows, threshold, seed):
    os.write(1, b"I have had enough\n")
    os._exit(7)


def failing(rows, threshold, seed):
    raise RuntimeError("no such luck [today]")


def identity(rows, threshold, seed):
    """A wrong answer, at once."""
    return np.eye(4)[:3]


def sometimes(rows, threshold, seed):
    if seed % 2:
        raise RuntimeError("not today")
    return honest(rows, threshold, seed)


def nearly(rows, threshold, seed):
    """The right answer turned by some degrees: many rows fit it, but not as rows fit what is right."""
    angle = np.radians(4.0)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    model = honest(rows, threshold, seed)
    middle = rows[:, 3:].mean(axis=0)
    return np.column_stack([turn @ model[:, :3], turn @ (model[:, 3] - middle) + middle])
