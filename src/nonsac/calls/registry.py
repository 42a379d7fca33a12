"""The calls that take their data from files: what the command line, manifests and jobs need to know of each."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

from nonsac.method.settings import Description, descriptions, read_number, read_positive

if TYPE_CHECKING:
    from nonsac.layouts import Layout
    from nonsac.result import Result

_SET_BY_OTHERS = ("workers", "progress")


@dataclass(frozen=True)
class Call:
    """One call. Nothing heavy is imported before it is used, so that `--help` answers at once.

    Attributes
    ----------
    name, home : str
        The function, and its module.
    minimal_size : int
        The least `sample_size`.
    layout_name, problem_name : str
        The columns of its rows, in `nonsac.layouts`, and what it solves, in `nonsac.problems`; empty if it takes none.
    files, more_files : tuple of str
        What its files are called: those that it needs, and those that it may have.
    images, cameras : tuple of str
        What the images and cameras are called that go with the files.
    own : dict
        Settings that no other call has, described.
    initial : dict
        Defaults that differ from those of `Settings`, as text.
    shared : tuple of str or None
        Which of `Settings` it takes; None for all.
    """

    name: str
    home: str
    minimal_size: int
    layout_name: str = ""
    problem_name: str = ""
    files: tuple[str, ...] = ()
    more_files: tuple[str, ...] = ()
    images: tuple[str, ...] = ()
    cameras: tuple[str, ...] = ()
    own: dict[str, Description] = field(default_factory=dict)
    initial: dict[str, str] = field(default_factory=dict)
    shared: tuple[str, ...] | None = None

    @property
    def command(self) -> str:
        """Its name on the command line and in manifests."""
        return self.name.replace("_", "-")

    @property
    def function(self) -> Callable[..., Result]:
        return getattr(import_module(self.home), self.name)

    @cached_property
    def layout(self) -> Layout | None:
        from nonsac import layouts

        return getattr(layouts, self.layout_name) if self.layout_name else None

    @cached_property
    def settings(self) -> dict[str, Description]:
        """What may be set, by the name of the argument."""
        chosen = {n: d for n, d in descriptions().items() if self.shared is None or n in self.shared}
        return {**chosen, **self.own}

    @property
    def texts(self) -> dict[str, str]:
        """The settings that can be given as text: from what they are called there to the name of the argument."""
        return {d.option or name: name for name, d in self.settings.items() if d.read is not None}

    @cached_property
    def arguments(self) -> tuple[str, ...]:
        """What may be set for this call in a job."""
        parameters = inspect.signature(self.function).parameters.values()
        names = [p.name for p in parameters if p.default is not p.empty and p.name not in _SET_BY_OTHERS]
        return (*self.images, *names)

    def read(self, name: str, text: str) -> Any:
        """A setting from text; a ValueError says what is wrong with it."""
        read = self.settings[name].read
        assert read is not None
        if name == "estimator":
            self._check_estimator(read(text))
        if name != "sample_size" or name in self.own:
            return read(text)
        value = _or_none(read, text)
        if value is None or (isinstance(value, int) and value < self.minimal_size):
            raise ValueError(f"{text!r} is neither a number of at least {self.minimal_size} nor 'auto'")
        return value

    def _check_estimator(self, name: str) -> None:
        from nonsac import problems
        from nonsac.estimators.named import ESTIMATORS, chosen_estimator, default_estimator

        problem = getattr(problems, self.problem_name)()
        if ESTIMATORS[name].fits(problem) and not ESTIMATORS[name].is_installed:
            chosen_estimator(name, problem)
        try:
            chosen_estimator(name, problem)
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"{name!r} is not for {self.command} ({error}); use {default_estimator(problem)}"
            ) from None


def _or_none(read: Callable[[str], Any], text: str) -> Any:
    try:
        return read(text)
    except ValueError:
        return None


def _read_scale(text: str) -> float | None:
    try:
        return None if text == "free" else read_positive(text)
    except ValueError:
        raise ValueError(f"{text!r} is neither a positive number nor 'free'") from None


_SCALE = Description(
    "float or None",
    "The known scale between the clouds, 1 for a rigid motion; None estimates it.",
    lambda value: value,
    _read_scale,
    "free|FLOAT",
    "Scale of T: known, or 'free' to estimate it.",
)

_CLOUD_SAMPLES = Description(
    "int",
    "At most this many samples of hypothesised pairs; fewer if several samples agree early.",
    lambda value: value,
    read_number(1),
    "INTEGER",
    "Draw at most this many samples.",
)
_CLOUD_SAMPLE_SIZE = Description(
    "int", "Hypothesised pairs in each sample.", lambda value: value, read_number(3), "INTEGER", "Rows in each sample."
)

CALLS = {
    call.name: call
    for call in (
        Call(
            "relative_pose",
            "nonsac.calls.poses",
            5,
            "MATCHES",
            "RelativePose",
            ("matches",),
            ("second",),
            images=("image1", "image2"),
            cameras=("camera1", "camera2"),
        ),
        Call(
            "absolute_pose",
            "nonsac.calls.poses",
            3,
            "POINTS",
            "AbsolutePose",
            ("points",),
            images=("image",),
            cameras=("camera",),
        ),
        Call(
            "register_pairs",
            "nonsac.calls.pairs",
            3,
            "PAIRS",
            "Registration",
            ("pairs",),
            ("second",),
            own={"scale": _SCALE},
            initial={"scale": "1"},
        ),
        Call(
            "register_clouds",
            "nonsac.calls.clouds",
            2,
            files=("source", "target"),
            own={"samples": _CLOUD_SAMPLES, "sample_size": _CLOUD_SAMPLE_SIZE},
            initial={"samples": "40", "sample_size": "2000"},
            shared=("samples", "sample_size", "workers", "rng", "progress"),
        ),
    )
}
