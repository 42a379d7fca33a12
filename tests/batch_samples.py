"""What the tests of many jobs run in worker processes, which import it by this name."""

import os
import signal
import threading
from dataclasses import dataclass

import numpy as np

import nonsac


def call(name, data, settings):
    return getattr(nonsac, name)(*data, workers=1, **settings)


def troublesome(number):
    if number == 7:
        raise ValueError("seven")
    if number == 11:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


@dataclass(frozen=True)
class Trouble(nonsac.Estimator):
    """Does something to the process that it is in, or raises: before there are samples, or in each of them."""

    action: str
    path: str = ""

    def check(self, problem):
        if self.action == "raise":
            raise Stubborn(1, 2)

    def estimate(self, problem, rows, noise, rng):
        if self.action == "die once" and not os.path.exists(self.path):
            open(self.path, "w").close()
            os.kill(os.getpid(), signal.SIGKILL)
        if self.action == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.action == "exit":
            os._exit(3)
        if self.action == "fail":
            raise Stubborn(1, 2)
        if self.action == "hang":
            os.write(1, b"at work\n")
            threading.Event().wait()  # until it is killed
        return nonsac.Pcr99.for_pairs().estimate(problem, rows, noise, rng)


class Stubborn(Exception):
    """Cannot be made from its message alone, so that it does not survive pickling."""

    def __init__(self, first, second):
        super().__init__(f"{first} and {second}")


def by_ransac(values, threshold, seed):
    """An estimator of registrations that is a function, as those of other libraries are."""
    estimator, rng = nonsac.Ransac(500, local_optimisation=True), np.random.default_rng(seed)
    rows, noise = nonsac.Rows(values), nonsac.Noise.within(threshold)
    return estimator.estimate(nonsac.Registration(), rows, noise, rng).model
