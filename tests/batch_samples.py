"""What the tests of many jobs run in worker processes, which import it by this name."""

import os
import signal
import threading
from dataclasses import dataclass

import nonsac


def call(name, data, settings):
    return getattr(nonsac, name)(*data, workers=1, **settings)


@dataclass(frozen=True)
class Trouble:
    """In place of an estimator: does something to the process that it is in."""

    action: str
    path: str = ""

    def estimate(self, problem, rows, threshold, rng):
        if self.action == "die once" and not os.path.exists(self.path):
            open(self.path, "w").close()
            os.kill(os.getpid(), signal.SIGKILL)
        if self.action == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.action == "exit":
            os._exit(3)
        if self.action == "raise":
            raise Stubborn(1, 2)
        if self.action == "hang":
            os.write(1, b"at work\n")
            threading.Event().wait()  # until it is killed
        return nonsac.Pcr99.for_pairs().estimate(problem, rows, threshold, rng)

    def with_budget(self, factor):
        return self


class Stubborn(Exception):
    """Cannot be made from its message alone, so that it does not survive pickling."""

    def __init__(self, first, second):
        super().__init__(f"{first} and {second}")
