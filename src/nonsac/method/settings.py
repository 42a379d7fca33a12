"""What may be set for an estimate: each setting described once, for the calls, the command line and manifests."""

from __future__ import annotations

import difflib
import inspect
import math
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Literal, TypedDict, TypeVar

# Nothing heavy is imported before it is used: the command line shows the settings in its `--help`.
from nonsac.values.numeric import LEAST, MOST, as_real, as_whole, shown

if TYPE_CHECKING:
    import numpy as np

    from nonsac.estimators.contract import Estimator
    from nonsac.estimators.external import Call
    from nonsac.method.refine import Refiner
    from nonsac.method.scoring import ScoringRule
    from nonsac.problems.contract import Problem
    from nonsac.running.executors import Workers

Auto = Literal["auto"]
Draw = Literal["rows", "blocks"]
Progress = Callable[[int, int], object]
Function = TypeVar("Function", bound=Callable[..., Any])

MOST_SAMPLES = 10**6
DRAWS = ("rows", "blocks")


class Keywords(TypedDict, total=False):
    """The settings as keyword arguments of a call; `Settings` says what each means."""

    noise: float | None
    samples: int | Auto
    sample_size: int | Auto
    draw: Draw
    max_samples: int
    max_uncertainty: float | None
    time_limit: float | None
    max_memory: int | str | None
    rule: str | ScoringRule
    refine: str | Refiner
    workers: Workers
    rng: int | np.random.Generator | None
    progress: Progress | None


class KeywordsAndEstimator(Keywords, total=False):
    """The same, for calls that have a default estimator."""

    estimator: str | Estimator | Call | None


@dataclass(frozen=True)
class Description:
    """What there is to know of a setting.

    Attributes
    ----------
    kind, doc : str
        Its type and meaning, for docstrings.
    check : callable
        From what was given to what is used; raises ValueError or TypeError, with a message that begins with the name.
    read : callable or None
        From text, of an option or of a cell of a manifest, to what is given; None if it cannot be given as text.
    form, help, default : str
        For the command line: what the text looks like, what it does, and what is shown for a default of None.
    option : str
        Its name there, if it is another one.
    """

    kind: str
    doc: str
    check: Callable[[Any], Any]
    read: Callable[[str], Any] | None = None
    form: str = "TEXT"
    help: str = ""
    default: str = ""
    option: str = ""


def _setting(default: Any, description: Description) -> Any:
    return field(default=default, metadata={"description": description})


# --- checks: from what was given to what is used -------------------------------------------


def _positive(name: str, meaning: str) -> Callable[[Any], float | None]:
    def check(value: Any) -> float | None:
        if value is None:
            return None
        number = as_real(value)
        if not 0.0 < number < math.inf:
            raise ValueError(f"{name} must be a positive number{meaning}, or None, got {shown(value)}")
        if not LEAST <= number <= MOST:
            raise ValueError(f"{name} must be from {LEAST:g} to {MOST:g}, or None, got {shown(value)}")
        return number

    return check


def _count(name: str, auto: bool, most: int | None = MOST_SAMPLES) -> Callable[[Any], int | Auto]:
    def check(value: Any) -> int | Auto:
        if auto and isinstance(value, str) and value == "auto":
            return "auto"
        number = as_whole(value)
        if number is None or number < 1:
            automatic = '"auto" or ' if auto else ""
            raise ValueError(f"{name} must be {automatic}an integer of at least 1, got {shown(value)}")
        if most is not None and number > most:
            raise ValueError(f"{name} must be at most {most:,}, got {shown(value)}")
        return number

    return check


def _draw(value: Any) -> Draw:
    if isinstance(value, str) and value in DRAWS:
        return value  # type: ignore[return-value]
    raise ValueError(f'draw must be "rows" or "blocks", got {shown(value)}')


def _memory(value: Any) -> int | None:
    from nonsac.running.memory import bytes_of

    return None if value is None else bytes_of(value)


def _rule(value: Any) -> ScoringRule:
    from nonsac.method import scoring

    return value if isinstance(value, scoring.ScoringRule) else scoring.by_name(value)


def _refiner(value: Any) -> Refiner:
    from nonsac.method import refine, refiners

    return value if isinstance(value, refine.Refiner) else refiners.by_name(value)


def _workers(value: Any) -> Workers:
    from nonsac.running.executors import parsed

    return parsed(value if as_whole(value) is None else as_whole(value))


def _random(value: Any) -> Any:
    from numpy.random import Generator

    if value is None or isinstance(value, Generator):
        return value
    number = as_whole(value)
    if number is not None and number >= 0:
        return number
    raise ValueError(f"rng must be a non-negative integer, a numpy Generator or None, got {shown(value)}")


def _progress(value: Any) -> Progress | None:
    if value is not None and not callable(value):
        raise TypeError(f"progress must be a function of (done, samples), got {shown(value)}")
    return value


# --- readers: from text to what is given ---------------------------------------------------


def read_positive(text: str) -> float:
    """A positive number."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < float("inf"):
        raise ValueError(f"{text!r} is not a positive number")
    return value


def read_number(least: int) -> Callable[[str], int]:
    """A whole number of at least so much."""

    def read(text: str) -> int:
        if not (text.isdecimal() and int(text) >= least):
            raise ValueError(f"{text!r} is not a whole number of at least {least}")
        return int(text)

    return read


def _read_count(text: str) -> int | Auto:
    if text == "auto":
        return "auto"
    if not (text.isdecimal() and int(text) >= 1):
        raise ValueError(f"{text!r} is neither a number of at least 1 nor 'auto'")
    return int(text)


def _read_draw(text: str) -> str:
    return _one_of(text, DRAWS)


def _read_memory(text: str) -> str:
    from nonsac.running.memory import bytes_of

    try:
        bytes_of(text)
    except ValueError:
        raise ValueError(f"{text!r} is no number of bytes, such as 500000000 or '500 MB'") from None
    return text


def _read_rule(text: str) -> str:
    from nonsac.method import scoring

    try:
        return scoring.by_name(text).name
    except ValueError as error:
        raise ValueError(str(error).replace(" or a rule object", "")) from None


def _read_estimator(text: str) -> str:
    from nonsac.estimators.named import ESTIMATORS

    return _one_of(text, ESTIMATORS)


def _read_refiner(text: str) -> str:
    from nonsac.method.refiners import REFINERS

    return _one_of(text, REFINERS)


def _one_of(text: str, names: Iterable[str]) -> str:
    if text not in (names := tuple(names)):
        raise ValueError(f"{text!r} is not one of {', '.join(names)}")
    return text


def _read_workers(text: str) -> int | str:
    if "://" in text:
        return text
    if not (text.isdecimal() and int(text) >= 1):
        raise ValueError(f"{text!r} is neither a number of at least 1 nor an address (tcp://host:8786)")
    return int(text)


# --- the settings --------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The settings of an estimate, checked; one more is a field here, and a line in `Keywords`."""

    noise: float | None = _setting(
        None,
        Description(
            "float, optional",
            "Standard deviation of an inlier, in the unit of the residual; rows with a residual below 5 `noise` are "
            "inliers. If it is left out it is found with the model, at one and a half times the work or two. If a "
            'given one is off by a factor of three or more, `info["remarks"]` '
            "says so.",
            _positive("noise", ", the standard deviation of an inlier"),
            read_positive,
            "FLOAT",
            "Standard deviation of a right match.",
            "measured",
        ),
    )
    samples: int | Auto = _setting(
        "auto",
        Description(
            '"auto" or int',
            'The paper\'s m. "auto" draws two samples, then as many again, and so on, until the answer is clear (a '
            "confidence of 0.99), `max_samples` are drawn, or ten times as many rows as there are. Samples do not "
            "overlap until fewer rows than a sample needs are left; then all rows are drawn anew.",
            _count("samples", auto=True),
            _read_count,
            "auto|INTEGER",
            "Number of samples; with 'auto' as many as it takes.",
        ),
    )
    sample_size: int | Auto = _setting(
        "auto",
        Description(
            '"auto" or int',
            'The paper\'s N. "auto" takes 2,000 rows, and more in later rounds if the inliers seen so far are so few '
            "that such a sample holds less than 20 of them (the paper's N >= I_min / P_min), at most 16,000. If all "
            "rows fit into one sample, one is drawn, and searched with the budget of all `samples`, or of ten.",
            _count("sample_size", auto=True, most=None),
            _read_count,
            "auto|INTEGER",
            "Rows in each; with 'auto' more if inliers are few.",
        ),
    )
    draw: Draw = _setting(
        "rows",
        Description(
            '"rows" or "blocks"',
            'What is drawn of a file: "rows" all over it, or some "blocks" at random (row groups of Parquet, chunks of '
            "HDF5, Zarr and LAZ, runs of neighbouring rows of other files), at least 16, and rows within these. Far "
            "less is then read of files that come in blocks. It is as good if the rows of a block are no more alike "
            'than others; if they are, as in a sorted file, `info["remarks"]` says so. Of arrays in memory and of all '
            "pairs rows are drawn in any case.",
            _draw,
            _read_draw,
            "rows|blocks",
            "Draw rows all over the file, or read some of its blocks only.",
        ),
    )
    max_samples: int = _setting(
        100,
        Description(
            "int",
            'At how many samples samples="auto" gives up.',
            _count("max_samples", auto=False),
            read_number(1),
            "INTEGER",
            "When --samples auto gives up.",
        ),
    )
    max_uncertainty: float | None = _setting(
        5.0,
        Description(
            "float, optional",
            "Degrees that the rotation may be uncertain by, at 95 %, and twice as many of the translation, seen as an "
            "angle; beyond, the status is `UNCERTAIN` (see `Result.uncertainty`). None trusts answers however "
            "uncertain they are. Problems that do not state an uncertainty are not judged by it.",
            _positive("max_uncertainty", " of degrees"),
            read_positive,
            "DEGREES",
            "Trust no answer that is more uncertain than this.",
        ),
    )
    time_limit: float | None = _setting(
        None,
        Description(
            "float, optional",
            "Seconds after which no further sample, or pass over all rows, is begun; one that has begun is finished. "
            "If that left samples undrawn and no answer is supported, the status is `TIME_LIMIT`. The same input may "
            "then give another answer.",
            _positive("time_limit", " of seconds"),
            read_positive,
            "SECONDS",
            "Begin no further sample after this time.",
            "none",
        ),
    )
    max_memory: int | None = _setting(
        None,
        Description(
            "int or str, optional",
            'Bytes, or words such as "500 MB", that the estimate may take beside what this process holds: bounds how '
            'many rows are sampled (with "auto"), and the rows of the last fit. Without it 100 samples of 2,000 rows '
            "take 60 MB.",
            _memory,
            _read_memory,
            "BYTES",
            "Memory for the sampled rows, as '500 MB': bounds the samples, and the rows of the last fit.",
            "none",
        ),
    )
    estimator: str | Estimator | Call | None = _setting(
        None,
        Description(
            "str, Estimator or callable, optional",
            'The core estimator that finds a model in one sample: a name ("ransac", "pcr99"), an object, or a '
            "function `f(values, threshold, seed)` that gives a model or None (see `External`). By default that of "
            "the problem.",
            lambda value: value,
            _read_estimator,
            "NAME",
            "Finds a model in one sample, by name: pcr99, ransac, teaser, ...; nonsac compare can list all.",
            "that of the problem",
        ),
    )
    rule: ScoringRule = _setting(
        "tlp_0.1",
        Description(
            "str or ScoringRule",
            "How one of the hypotheses is selected: a name (see `nonsac.scoring`) or an object. It decides the answer "
            'only with refine="none", because the other refiners compare all hypotheses anew.',
            _rule,
            _read_rule,
            "NAME",
            "How one of the hypotheses is selected (tlp_0.1, most_inliers, ...); decides the answer only with "
            "--refine none.",
        ),
    )
    refine: Refiner = _setting(
        "polish",
        Description(
            '"union", "polish", "full", "none", "average" or Refiner',
            '"union" searches once more where the samples\' findings meet, rescores all hypotheses on all sampled rows '
            'and refits the best; "polish" then fits it to at least 100,000 rows, or all; "full" fits a trusted answer '
            'to all rows, in some passes over the source in constant memory; "none" returns the selected one, and '
            '"average" a robust average of all.',
            _refiner,
            _read_refiner,
            "union|polish|full|none|average",
            "The last fit: to the sampled rows, to 100,000, to all rows (in passes over them), or none; average takes "
            "the average of all hypotheses.",
        ),
    )
    workers: Workers = _setting(
        None,
        Description(
            "None, int, concurrent.futures.Executor, Dask client or str",
            'One thread for each core, this many threads, a pool, or a cluster: a client, "dask" for the one that '
            "there is, or a scheduler's address (tcp://host:8786). The answer is the same, bit for bit, even if "
            "workers die.",
            _workers,
            _read_workers,
            "INTEGER|ADDRESS",
            "Number of threads, or the address of a Dask scheduler (tcp://host:8786).",
            "all cores",
        ),
    )
    rng: int | np.random.Generator | None = _setting(
        0,
        Description(
            "int, numpy Generator or None",
            'The seed; None takes fresh entropy, which is recorded in `info["seed"]`.',
            _random,
            read_number(0),
            "INTEGER",
            "Same seed, same answer.",
            option="seed",
        ),
    )
    progress: Progress | None = _setting(
        None,
        Description(
            "callable, optional",
            "Called as `progress(done, samples)`; `samples` are the most that there may be.",
            _progress,
        ),
    )

    @classmethod
    def of(cls, call: str, given: Mapping[str, Any], **defaults: Any) -> Settings:
        """The settings of a call, checked; what was not given is by default as here, or as in `defaults`."""
        known = descriptions()
        for name in given:
            if name not in known:
                close = difflib.get_close_matches(name, known, 1)
                hint = f"; did you mean {close[0]}?" if close else ""
                raise TypeError(f"{call}() got an unexpected keyword argument {name!r}{hint}")
        values = {each.name: each.default for each in fields(cls)} | defaults | dict(given)
        return cls(**{name: known[name].check(value) for name, value in values.items()})

    def fitting(self, problem: Problem) -> Settings:
        """These settings, if they fit the problem."""
        least = problem.minimal_size
        if self.sample_size != "auto" and self.sample_size < least:
            raise ValueError(f'sample_size must be "auto" or an integer of at least {least}, got {self.sample_size!r}')
        self.refine.check(problem)
        return self


def descriptions() -> dict[str, Description]:
    """What there is to know of each setting, by its name."""
    return {each.name: each.metadata["description"] for each in fields(Settings)}


def default_of(name: str) -> Any:
    """What a setting is if it is not given."""
    return next(each.default for each in fields(Settings) if each.name == name)


def shows_settings(*without: str, **defaults: Any) -> Callable[[Function], Function]:
    """Lets `help()` and completion show the settings that a function takes as `**settings`.

    A line `{settings}` in its docstring becomes their descriptions, and `{others}` the names of those that it does not
    describe.
    """

    def decorated(function: Function) -> Function:
        signature, kinds = inspect.signature(function), KeywordsAndEstimator.__annotations__
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        shown = [each for each in fields(Settings) if each.name not in {*without, *(p.name for p in own)}]
        settings = [
            inspect.Parameter(
                each.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=defaults.get(each.name, each.default),
                annotation=kinds[each.name].__forward_arg__,
            )
            for each in shown
        ]
        function.__signature__ = signature.replace(parameters=[*own, *settings])  # type: ignore[attr-defined]
        described = "\n".join(_described(each.name) for each in shown)
        text = (function.__doc__ or "").replace("    {settings}", described)
        others = ", ".join(each.name for each in shown if f"\n    {each.name} : " not in text)
        function.__doc__ = text.replace("{others}", others)
        return function

    return decorated


def _described(name: str) -> str:
    """A setting as a docstring of NumPy's style has it."""
    description = descriptions()[name]
    body = textwrap.fill(description.doc, 112, initial_indent=" " * 8, subsequent_indent=" " * 8)
    return f"    {name} : {description.kind}\n{body}"
