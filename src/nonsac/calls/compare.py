"""Which method to take on one's own data: each is run in a process of its own, and judged on rows that none saw."""

from __future__ import annotations

import pickle
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from nonsac.calls.compared_data import ComparedData, opened, shareable, split, truth_of
from nonsac.calls.compared_runs import ALONE, CORE, Alone, Core, Rules, Run, Subject, WarmUp, reference
from nonsac.calls.comparison import NOT_INSTALLED, OK, Compared, Comparison
from nonsac.calls.run_arguments import Progress
from nonsac.estimators.named import ESTIMATORS, chosen_estimator, default_estimator, estimators_for
from nonsac.evaluation import mean_average_accuracy
from nonsac.kernels.ahead import compile_for
from nonsac.layouts import Array
from nonsac.method.residuals import Residuals
from nonsac.problems import RelativePose
from nonsac.problems.contract import Problem, solved
from nonsac.problems.noise import Noise
from nonsac.problems.pose import rotation_distance
from nonsac.result import Status
from nonsac.running.confined import Confined, Ended, Reason, failure
from nonsac.running.memory import bytes_of
from nonsac.seeds import canonical_seed
from nonsac.values.checks import flag, iterable, listed, whole_number
from nonsac.values.numeric import LEAST, as_real, shown
from nonsac.values.quiet import quiet
from nonsac.values.version import VERSION

USES, RULES = (ALONE, CORE), "rules"
_ALONE_SIZE = 2000
_FAR = 20.0  # degrees: what is farther is wrong, no matter how far
_MOST_REPEATS, _MOST_WORKERS = 1000, 256
_MODELS, _LITTLE = 8, 0.01
_POINTS = 1000
_FIRST_CALL = 60.0  # seconds: kernels may have to be compiled


def compare(
    call: str | Problem,
    *data: Any,
    methods: Iterable[str] | Mapping[str, Any] | None = None,
    uses: Iterable[str] = USES,
    sizes: Iterable[int] | None = None,
    noise: float | Iterable[float] | None = None,
    repeats: int = 3,
    truth: Any = None,
    rules: bool = False,
    samples: Iterable[int] = (10, 20, 30),
    time_limit: float = 60.0,
    max_memory: int | str = "4 GB",
    workers: int = 1,
    rng: int | np.random.Generator | None = 0,
    progress: Progress | None = None,
    **settings: Any,
) -> Comparison:
    """Compare core estimators, sample sizes and thresholds on data of your own.

    Each method runs in a process of its own, within a time and a memory limit: what is too slow, too large, crashes,
    fails or is not installed is an outcome like any other. The first call, in which libraries and kernels are loaded,
    does not count.

    Parameters
    ----------
    call : str or Problem
        "relative_pose", "absolute_pose" or "register_pairs", or a problem of your own.
    *data : arrays, paths or Source
        What the call takes first: two arrays, files as for `nonsac.Job`, or a source. A problem takes a source.
    methods : iterable of str, or dict, optional
        Names of core estimators; or your own by a name each, as `estimator=` takes them. By default all that there are
        for the problem.
    uses : iterable of str
        "alone" is the estimator on one sample, as it is used without NONSAC; "core" is the method with its default
        settings, and the estimator as its core.
    sizes : iterable of int, optional
        Rows in a sample; by default 2,000 alone, and what the method chooses.
    noise : float or iterable of float, optional
        Standard deviations of an inlier, in the unit of the call; by default what the default method measures.
    repeats : int
        Runs of each, with different seeds.
    truth : array (4, 4) or path, optional
        The true transform: text, or JSON or NPZ that holds it (`nonsac.io.read_truth`).
    rules : bool
        Whether to compare the paper's scoring rules instead, over `methods` (by default the default estimator), sizes,
        and numbers of samples.
    samples : iterable of int
        For the rules, the paper's m.
    time_limit : float
        Seconds for each run, and for the first call at least 60. A method that takes more is not run again on samples
        as large.
    max_memory : int or str
        Bytes, or words such as "500 MB", of address space that a run may take beside what its process holds before.
        Enforced on Linux.
    workers : int
        How many methods run at once; with more than 1 they wait for each other, so that times say less.
    rng : int, numpy Generator or None
        The seed.
    progress : callable, optional
        Called as `progress(done, runs)`.
    **settings
        For a call: `camera1`, `camera2`, `camera`, `image1`, `image2`, `image`, `scale`, `weights`, and for tables
        `columns` and `dataset`.

    Returns
    -------
    Comparison

    Raises
    ------
    ValueError, TypeError, InputError
        If an argument is out of its range, or the data cannot be read; the message names it.

    Notes
    -----
    A fifth of the rows, 20,000 at most, is held out: no method sees them. Without a truth, methods are ranked by how
    many of them are inliers of the answer beyond those that are by chance, as far as our verdict trusts the answer.
    """
    plan = _Plan(
        _uses(uses),
        None if sizes is None else _counts("sizes", sizes, 3),
        _noises(noise),
        whole_number("repeats", repeats, 1, _MOST_REPEATS),
        _counts("samples", samples, 1) if flag("rules", rules) else (),
        _Limits(
            _positive("time_limit", time_limit, "seconds"),
            bytes_of(max_memory),
            whole_number("workers", workers, 1, _MOST_WORKERS),
        ),
        canonical_seed(rng),
    )
    if progress is not None and not callable(progress):
        raise TypeError(f"progress must be a function of (done, total), or None, got {shown(progress)}")
    source, problem = opened(call, data, settings)
    chosen = _chosen_methods(methods, problem, rules, weighted=source.width > problem.width)
    true_model = truth_of(truth, problem)
    name = call.replace("-", "_") if isinstance(call, str) else ""
    if name:
        compile_for(name, None)
    with shareable(source) as shared:
        compared = split(shared, problem, plan.seed, name)
        return _compared(compared, plan, chosen, true_model, progress)


# --- the arguments -------------------------------------------------------------------------


@dataclass(frozen=True)
class _Limits:
    seconds: float
    memory: int
    workers: int


@dataclass(frozen=True)
class _Plan:
    """What is to be run; `counts` are the numbers of samples if rules are compared."""

    uses: tuple[str, ...]
    sizes: tuple[int, ...] | None
    noises: tuple[float, ...]
    repeats: int
    counts: tuple[int, ...]
    limits: _Limits
    seed: int

    def cells(self, some_noise: float, rows: int) -> list[_Cell]:
        """What each method is run at, on at most so many rows; `some_noise` is for what needs one that nobody gave."""
        noises: Sequence[float | None] = self.noises or (None,)
        return [
            _Cell(use, size, noise or (None if use == CORE else some_noise), noise is not None)
            for use in ((RULES,) if self.counts else self.uses)
            for size in self._sizes(use, rows)
            for noise in noises
        ]

    def _sizes(self, use: str, rows: int) -> Sequence[int | None]:
        """Rows in a sample, each number once; None is what the method chooses."""
        if self.sizes is None and use == CORE:
            return (None,)
        return sorted({min(size, rows) for size in self.sizes or (_ALONE_SIZE,)})


@dataclass(frozen=True)
class _Cell:
    """One way to use a method; `known` says whether the noise was given, and not measured."""

    use: str
    size: int | None
    noise: float | None
    known: bool

    def task(self, seed: int, plan: _Plan, truth: Array | None) -> Any:
        if self.use == CORE:
            return Core(self.size, self.noise, seed)
        assert self.size is not None
        assert self.noise is not None
        if self.use == ALONE:
            return Alone(self.size, self.noise, seed, self.known)
        return Rules(self.size, self.noise, seed, plan.counts, self.known, truth)


def _positive(name: str, value: Any, unit: str) -> float:
    number = as_real(value)
    if not 0.0 < number < np.inf:
        raise ValueError(f"{name} must be a positive number of {unit}, got {shown(value)}")
    return number


def _uses(uses: Any) -> tuple[str, ...]:
    chosen = tuple(dict.fromkeys(listed("uses", uses, 'a sequence of "alone" and "core"')))
    if not chosen or not all(isinstance(use, str) and use in USES for use in chosen):
        raise ValueError(f'uses must hold "alone", "core" or both, got {shown(uses)}')
    return chosen


def _counts(name: str, values: Any, least: int) -> tuple[int, ...]:
    chosen = [whole_number(name, value, least, 10**6) for value in listed(name, values, "a sequence of integers")]
    if not chosen:
        raise ValueError(f"{name} must hold at least one integer, got none")
    return tuple(sorted(set(chosen)))


def _noises(noise: Any) -> tuple[float, ...]:
    if noise is None:
        return ()
    values = [noise] if np.ndim(noise) == 0 and not isinstance(noise, Iterable) else listed("noise", noise, "numbers")
    if not values:
        raise ValueError("noise must hold at least one number, got none; leave it out to have it measured")
    return tuple(sorted({_positive("noise", value, "the unit of the residual") for value in values}))


def _chosen_methods(methods: Any, problem: Problem, rules: bool, weighted: bool) -> dict[str, Any]:
    """The methods by name; the name itself, or what was given for it."""
    if methods is None:
        names = [default_estimator(problem)] if rules else estimators_for(problem)
        return {name: name for name in names if weighted or not ESTIMATORS[name].weighted}
    if isinstance(methods, Mapping):
        for name, method in methods.items():
            if not isinstance(name, str):
                raise TypeError(f"methods must have names, strings all of them, got {shown(name)}")
            chosen_estimator(method, problem)
            _check_travels(name, method)
        chosen = dict(methods)
    else:
        names = list(iterable("methods", methods, "a sequence of names, or a dict"))
        for name in names:
            _check_name(name, problem)
        chosen = {name: name for name in names}
    if not chosen:
        raise ValueError("methods must hold at least one, got none; leave it out to compare all")
    return chosen


def _check_name(name: Any, problem: Problem) -> None:
    fitting = estimators_for(problem)
    if not isinstance(name, str) or name not in fitting:
        raise ValueError(f"methods must be of {', '.join(fitting)} for {type(problem).__name__}, got {shown(name)}")


def _check_travels(name: str, method: Any) -> None:
    try:
        pickle.dumps(method)
    except Exception as error:  # what is pickled may raise anything
        raise ValueError(
            f"methods[{name!r}] does not travel to a process of its own ({error}): use a function of a module"
        ) from None


# --- the runs ------------------------------------------------------------------------------


def _compared(
    data: ComparedData, plan: _Plan, methods: dict[str, Any], truth: Array | None, progress: Progress | None
) -> Comparison:
    measured, default, remarks = _measured_noise(data, plan)
    judged_at = measured or float(np.median(plan.noises or [0.0])) or None
    cells = plan.cells(measured or _some_noise(data), len(data.seen))
    runs = _all_runs(data, plan, methods, cells, truth, progress)
    judge = _Judge(data, judged_at, truth, default)
    rows = judge.rows(runs, plan)
    if not len(data.held_out):
        remarks = (*remarks, "there are too few rows to hold some out")
    return Comparison(
        call=data.call or type(data.problem).__name__,
        rows=tuple(sorted(rows, key=_rank)),
        num_rows=data.num_rows,
        num_held_out=len(data.held_out),
        noise=judged_at,
        truth=truth is not None,
        seed=plan.seed,
        remarks=remarks,
        version=VERSION,
        by_rule=bool(plan.counts),
        default_held_out=judge.default_held_out,
    )


def _rank(row: Compared) -> tuple[bool, float, float]:
    return row.outcome != OK, -round(row.merit, 2), np.inf if row.cpu_seconds is None else row.cpu_seconds


def _measured_noise(data: ComparedData, plan: _Plan) -> tuple[float | None, Array | None, tuple[str, ...]]:
    """The noise that the default method measures, if nobody gives it, or several; its answer, if that is to be trusted.

    And what is to be said of it.
    """
    if len(plan.noises) == 1:
        return plan.noises[0], None, ()
    process = Confined(reference(data.seen, data.problem, data.call), plan.limits.memory)
    try:
        ended = process.call(Core(None, None, plan.seed), time_limit=plan.limits.seconds)
    finally:
        process.close()
    if ended.reason is not None:
        return None, None, (f"the noise could not be measured ({ended.reason}: {ended.detail}); give one",)
    noise = float(ended.value.noise)
    if not 0.0 < noise < np.inf:
        return None, None, ("the noise could not be measured, as nothing was found",)
    if ended.value.status != Status.OK:
        return noise, None, ("the noise is that of an answer that is not trusted; give it, if you know it",)
    return noise, ended.value.model, ()


@quiet
def _some_noise(data: ComparedData) -> float:
    """A noise for estimators that need one if none can be measured: much less than rows show by chance."""
    problem, rows = data.problem, data.held_out.values
    size = problem.minimal_size
    some = rows[: min(len(rows) // size, _MODELS) * size].reshape(-1, size, problem.width)
    models = solved(problem, some)
    residuals = problem.residuals(models, rows) if len(models) else np.ones(1)
    by_chance = float(np.median(residuals[np.isfinite(residuals)])) if np.isfinite(residuals).any() else 1.0
    return max(_LITTLE * by_chance, LEAST)


@dataclass(frozen=True)
class _CellRuns:
    """What became of the runs of a cell: runs, or what rules made of one; and why some were lost."""

    method: str
    cell: _Cell
    found: tuple[Any, ...] = ()
    lost: Ended | None = None
    installed: bool = True


@dataclass
class _Method:
    """The runs of one method in its process, one after the other."""

    name: str
    process: Confined
    plan: _Plan
    truth: Array | None
    tell: Callable[[int], None]
    warm: set[tuple[int, str]] = field(default_factory=set)
    too_much: dict[str, tuple[int, Ended]] = field(default_factory=dict)

    def __call__(self, cells: Sequence[_Cell]) -> list[_CellRuns]:
        try:
            return [self._runs(cell) for cell in cells]
        finally:
            self.process.close()

    def _runs(self, cell: _Cell) -> _CellRuns:
        """The runs of a cell, until one is too much or crashes."""
        found: list[Any] = []
        lost = self._known_to_be_too_much(cell) or self._warmed_up(cell)
        left = self.plan.repeats
        for number in range(left if lost is None else 0):
            ended = self._run(cell, number)
            left -= 1
            self.tell(1)
            if ended.reason is None:
                found.append(ended.value)
                continue
            lost = ended
            if ended.reason is not Reason.FAILED:
                break
        self.tell(left)
        if lost is not None and lost.reason in (Reason.LATE, Reason.OUT_OF_MEMORY):
            self.too_much.setdefault(cell.use, (cell.size or 0, lost))
        return _CellRuns(self.name, cell, tuple(found), lost)

    def _run(self, cell: _Cell, number: int) -> Ended:
        seed = self.plan.seed + number
        ended = self.process.call(cell.task(seed, self.plan, self.truth), time_limit=self.plan.limits.seconds)
        fault = ended.value.fault if isinstance(ended.value, Run) and ended.value.model is None else ""
        return failure(fault) if fault else ended

    def _warmed_up(self, cell: _Cell) -> Ended | None:
        """How the first call ended, if the method did not survive it."""
        limit = max(self.plan.limits.seconds, _FIRST_CALL)
        ended = self.process.start(limit)
        if ended is not None:
            return ended
        if (self.process.starts, cell.use) in self.warm:
            return None
        ended = self.process.call(WarmUp(cell.use == ALONE, cell.noise), time_limit=limit)
        self.warm.add((self.process.starts, cell.use))
        if ended.reason in (None, Reason.FAILED):  # the run itself will tell
            return None
        return replace(ended, detail=f"{ended.detail} (in the first call, on few rows)")

    def _known_to_be_too_much(self, cell: _Cell) -> Ended | None:
        size, ended = self.too_much.get(cell.use, (np.inf, None))
        return ended if (cell.size or 0) >= size else None


def _all_runs(
    data: ComparedData,
    plan: _Plan,
    methods: dict[str, Any],
    cells: Sequence[_Cell],
    truth: Array | None,
    progress: Progress | None,
) -> list[_CellRuns]:
    """The runs of all methods, so many methods at once; none outlives this, however it ends."""
    missing = {name: _what_is_missing(method) for name, method in methods.items()}
    absent = {name: told for name, told in missing.items() if told}
    nothing = [_CellRuns(name, cells[0], lost=Ended(detail=told), installed=False) for name, told in absent.items()]
    present = {name: method for name, method in methods.items() if name not in absent}
    board = _Board(len(cells) * plan.repeats * len(present), progress)
    with ExitStack() as stack:
        running = []
        for name, method in present.items():
            process = Confined(Subject(data.seen, data.problem, method, data.call), plan.limits.memory)
            stack.callback(process.close)
            running.append(_Method(name, process, plan, truth, board.tell))
        pool = stack.enter_context(ThreadPoolExecutor(plan.limits.workers, thread_name_prefix="nonsac"))
        futures = [pool.submit(method, cells) for method in running]
        try:
            wait(futures, return_when=FIRST_EXCEPTION)
            return [*(runs for future in futures for runs in future.result()), *nothing]
        finally:
            for future in futures:
                future.cancel()
            for method in running:
                method.process.cancel()


def _what_is_missing(method: Any) -> str:
    """How to get what a named method needs, if that is not installed."""
    named = ESTIMATORS.get(method) if isinstance(method, str) else None
    return "" if named is None or named.is_installed else how_to_get(method)


def how_to_get(name: str) -> str:
    """The command that installs what a named method needs; "" if it needs nothing."""
    named = ESTIMATORS[name]
    if named.extra is not None:
        return f'pip install "nonsac[{named.extra}]"'
    return "" if named.needs is None else f"needs the module {named.needs}"


class _Board:
    """Counts runs that are done, from several threads."""

    def __init__(self, total: int, progress: Progress | None) -> None:
        self.total, self.done, self.progress, self.lock = total, 0, progress, threading.Lock()

    def tell(self, runs: int) -> None:
        """So many more are done, or will not be done."""
        with self.lock:
            self.done += runs
            if self.progress is not None:
                self.progress(self.done, self.total)


# --- the judgement -------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Judge:
    """Judges all answers alike; `default` is that of the default method, which measured the noise."""

    data: ComparedData
    noise: float | None
    truth: Array | None
    default: Array | None = None

    @property
    def default_held_out(self) -> float | None:
        """Share of the held-out rows that the answer of the default method explains."""
        return None if self.default is None else self._held_out(self.default)

    def rows(self, runs: Sequence[_CellRuns], plan: _Plan) -> list[Compared]:
        by_row = [each for cell in runs for each in _by_row(cell, plan, self.truth)]
        models = [run.model for _, found in by_row for run in found if run.model is not None]
        consensus = self._consensus(models if self.default is None else [*models, self.default])
        return [self._judged(row, found, consensus) for row, found in by_row]

    def _judged(self, row: Compared, found: Sequence[Run], consensus: Array | None) -> Compared:
        if not found:
            return row
        models = [run.model for run in found]
        fits = [self._held_out(model) for model in models]
        trusted = np.array([run.status == Status.OK for run in found])
        statuses = Counter(run.status or "no answer" for run in found)
        judged = row.use in USES or any(run.status for run in found)
        merit = float(np.sum(np.where(trusted | (not judged), np.nan_to_num(fits), 0.0)) / row.repeats)
        if self.truth is not None:
            errors = [self._error(model) for model in models]
            lost = [np.nan] * (row.repeats - len(errors))
            accuracy = mean_average_accuracy([*errors, *lost])
            row = replace(
                row,
                accuracy=accuracy,
                rotation_error=_median([self._rotation_error(model) for model in models]),
                translation_error=_median([self._translation_error(model) for model in models]),
            )
            merit = accuracy
        memory = [run.used.memory for run in found if run.used.memory is not None]
        return replace(
            row,
            held_out=float(np.nansum(fits) / row.repeats) if len(self.data.held_out) and self.noise else None,
            agreement=None if consensus is None else _median([self._distance(model, consensus) for model in models]),
            trusted=float(trusted.sum() / row.repeats) if judged else None,
            status=statuses.most_common(1)[0][0] if judged else None,
            confidence=_median([run.confidence for run in found]) if judged else None,
            merit=max(merit, 0.0),
            seconds=_median([run.used.seconds for run in found]),
            cpu_seconds=_median([run.used.cpu_seconds for run in found]),
            peak_memory=max(memory) if memory else None,
        )

    @cached_property
    def _threshold(self) -> float:
        return Noise.given(self.noise or 1.0).threshold

    @quiet
    def _held_out(self, model: Array | None) -> float:
        """Share of the held-out rows that fit a model beyond chance."""
        if model is None or self.noise is None or not len(self.data.held_out):
            return 0.0
        return max(Residuals.of(self.data.problem, model, self.data.held_out).support(self._threshold), 0.0)

    @quiet
    def _distance(self, model: Array | None, other: Array) -> float:
        """In degrees, the larger of those of rotation and translation; NaN without a model."""
        if model is None:
            return float("nan")
        if self.data.problem.transform(other) is None:
            return float(self.data.problem.distance(model, other))
        return max(float(rotation_distance(_rotation(model), _rotation(other))), self._shift_angle(model, other))

    def _shift_angle(self, model: Array, other: Array) -> float:
        """Between the directions of t; or how far points move apart, seen over the extent of the scene."""
        if isinstance(self.data.problem, RelativePose):
            return _angle_between(model[:, 3], other[:, 3])
        points = self._points
        moved, there = (points @ each[:, :3].T + each[:, 3] for each in (model, other))
        extent = float(np.median(np.linalg.norm(there - np.median(there, axis=0), axis=1)))
        apart = float(np.median(np.linalg.norm(moved - there, axis=1)))
        return float(np.degrees(np.arctan2(apart, extent)))

    @cached_property
    def _points(self) -> Array:
        """Some points (n, 3) that a motion moves: of the source, or of the world."""
        data, few = self.data, np.arange(min(len(self.data.seen), _POINTS), dtype=np.int64)
        rows = data.held_out.values[:_POINTS] if len(data.held_out) else data.seen.take(few)[:, : data.problem.width]
        return next(half for half in data.problem.layout.parts(rows) if half.shape[1] == 3)

    def _error(self, model: Array | None) -> float:
        assert self.truth is not None
        return self._distance(model, self.truth)

    def _rotation_error(self, model: Array | None) -> float:
        if model is None or self.truth is None or self.data.problem.transform(self.truth) is None:
            return self._error(model)
        return float(rotation_distance(_rotation(model), _rotation(self.truth)))

    @quiet
    def _translation_error(self, model: Array | None) -> float:
        if model is None or self.truth is None or self.data.problem.transform(self.truth) is None:
            return float("nan")
        if isinstance(self.data.problem, RelativePose):
            return _angle_between(model[:, 3], self.truth[:, 3])
        return float(np.linalg.norm(model[:, 3] - self.truth[:, 3]))

    def _consensus(self, models: Sequence[Array]) -> Array | None:
        """The answer that is nearest to all, each counted by the held-out rows that fit it."""
        if not models:
            return None
        weights = np.array([self._held_out(model) for model in models]) + 1e-6
        costs = [
            weights @ np.minimum(np.nan_to_num([self._distance(b, a) for b in models], nan=_FAR), _FAR) for a in models
        ]
        return models[int(np.argmin(costs))]


def _angle_between(a: Array, b: Array) -> float:
    """Degrees between two directions."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return float(np.degrees(2.0 * np.arcsin(min(0.5 * float(np.linalg.norm(a - b)), 1.0))))


def _rotation(model: Array) -> Array:
    """Of a motion, whatever its scale."""
    return np.asarray(model[:, :3] / np.cbrt(np.linalg.det(model[:, :3])))


def _by_row(runs: _CellRuns, plan: _Plan, truth: Array | None) -> list[tuple[Compared, list[Run]]]:
    """The rows that a cell has in the table, one for each rule and number of samples if rules are compared."""
    cell, lost = runs.cell, runs.lost
    outcome = OK if runs.found else (NOT_INSTALLED if not runs.installed else str(lost.reason) if lost else OK)
    row = Compared(
        runs.method,
        cell.use if runs.installed else "",
        sample_size=cell.size,
        noise=cell.noise,
        outcome=outcome,
        detail="" if lost is None else lost.detail,
        runs=len(runs.found),
        repeats=plan.repeats,
    )
    if not plan.counts or not runs.found:
        return [(row, list(runs.found))]
    names = cell.task(plan.seed, plan, truth).names()
    return [
        (replace(row, use=name, samples=count), [found[count, name] for found in runs.found])
        for count in plan.counts
        for name in names
    ]


def _median(values: Sequence[float]) -> float | None:
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else None
