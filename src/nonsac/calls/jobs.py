"""Many pairs: one job for each, on processes or any executor; one that fails never stops the others."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from dataclasses import dataclass
from typing import Any

import numpy as np

from nonsac.calls.registry import CALLS, Call
from nonsac.cameras.unreadable import chosen_cameras
from nonsac.files.content import may_end_process
from nonsac.kernels.ahead import compile_for
from nonsac.result import Result
from nonsac.running.executors import Workers, parsed
from nonsac.running.many import pool_of, run_many
from nonsac.running.processes import WorkerDied
from nonsac.seeds import canonical_seed
from nonsac.values.checks import iterable
from nonsac.values.numeric import shown

__all__ = ["Job", "WorkerDied", "estimate_many"]

Outcome = Result | Exception
Progress = Callable[[int, int | None], object]


@dataclass(frozen=True, init=False, eq=False)
class Job:
    """One of the four calls, with its data and settings, to be run later and elsewhere.

    Parameters
    ----------
    call : str
        "relative_pose", "absolute_pose", "register_pairs" or "register_clouds".
    *data : arrays or paths
        What the call takes first, as arrays; or the names of files, read where the job runs: `matches` (or `features`
        and `matches` of hloc), `points`, `pairs` (or `source` and `target`), `source` and `target`. Weights and cameras
        of a file are used if the settings name no others.
    name : str
        Tells the job apart from others.
    **settings
        Keyword arguments of the call, but not `workers` and `progress`. For files with many images also `image1` and
        `image2`, or `image`: names, or numbers of COLMAP.

    Raises
    ------
    ValueError, TypeError
        If there is no such call or setting, or the data are arrays in part and files in part.

    Examples
    --------
    >>> Job("register_pairs", "left.ply", "right.ply", noise=0.01, name="left to right")
    Job('register_pairs', name='left to right')
    """

    call: str
    data: tuple[Any, ...]
    settings: Mapping[str, Any]
    name: str

    def __init__(self, call: str, /, *data: Any, name: str = "", **settings: Any) -> None:
        if not isinstance(call, str) or call not in CALLS:
            raise ValueError(f"call must be one of {', '.join(CALLS)}, got {shown(call)}")
        known = CALLS[call].arguments
        for setting in settings:
            if setting not in known:
                raise TypeError(f"{call} has no setting {setting!r} in a job; it has {', '.join(known)}")
        if len(set(map(is_path, data))) > 1:
            raise TypeError(f"the data of a job are arrays or paths, not both; got {len(data)} of mixed kinds")
        if "rng" in settings and settings["rng"] is not None:  # a generator is drawn from now, in the order of the jobs
            settings["rng"] = canonical_seed(settings["rng"])
        for field, value in (("call", call), ("data", data), ("settings", settings), ("name", name)):
            object.__setattr__(self, field, value)

    def __repr__(self) -> str:
        return f"Job({self.call!r}, name={self.name!r})"

    def compile(self) -> None:
        """Compile what the job calls, on all cores, if it is not yet: workers would each compile it for themselves."""
        compile_for(self.call, self.settings.get("noise"))

    def run(self, time_limit: float | None = None) -> Result:
        """Read the files, if any, and make the call on one thread.

        Parameters
        ----------
        time_limit : float, optional
            Seconds, for the calls that take a limit (`register_clouds` takes none), if the settings hold none.

        Returns
        -------
        Result
            That of the call with `workers=1`, bit for bit.

        Raises
        ------
        InputError, ValueError, TypeError
            What the readers and the call raise.
        """
        call, settings = CALLS[self.call], dict(self.settings)
        if time_limit is not None and "time_limit" in call.settings:
            settings.setdefault("time_limit", time_limit)
        data = _read(call, self.data, settings) if any(map(is_path, self.data)) else self.data
        return call.function(*data, workers=1, **settings)


def estimate_many(
    jobs: Iterable[Job],
    *,
    workers: Workers = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
) -> Iterator[tuple[Job, Outcome]]:
    """Run many jobs, and give their outcomes in the order of the jobs, each as soon as those before it are there.

    Parameters
    ----------
    jobs : iterable of Job
        May be a generator: jobs are taken from it as they are needed, at most two for each worker ahead of what was
        given back, so that their number does not matter.
    workers : None, int, concurrent.futures.Executor, Dask client or str
        One process for each core, this many processes, or an executor; a Dask client, "dask" or a scheduler's address
        as for the calls. With 1, all runs in the calling process, except jobs of LAS, Parquet, Arrow and HDF5 files,
        of which a damaged one may end the process that reads it: these run in another one, unless the script lacks the
        following. A script that uses processes needs `if __name__ == "__main__":`.
    time_limit : float, optional
        Seconds for each job, handed on to the calls that take it: all but `register_clouds`.
    progress : callable, optional
        Called as `progress(done, total)`; `total` is None if `jobs` has no length.

    Yields
    ------
    job : Job
    outcome : Result or Exception
        The result, the same bits as that of the call with `workers=1`; or what went wrong: a file that cannot be read,
        an exception, or `WorkerDied` if the process of the job was killed twice (the other jobs go on). An executor
        that you bring and that breaks as a whole ends the run, with its own exception.

    Raises
    ------
    ValueError, TypeError
        If `workers` is not as above, or something else than a job comes.
    """
    iterable("jobs", jobs, "an iterable of objects of nonsac.Job")
    if progress is not None and not callable(progress):
        raise TypeError(f"progress must be a function of (done, total), or None, got {shown(progress)}")
    pool = parsed(workers)  # at once, and not when the first outcome is asked for
    total = len(jobs) if isinstance(jobs, Sized) else None
    return _counted(_outcomes(_Run(time_limit), jobs, pool), total, progress)


@dataclass(frozen=True)
class _Run:
    """What travels to the workers."""

    time_limit: float | None

    def __call__(self, job: Job) -> Result:
        return job.run(self.time_limit)


def may_end(job: Job) -> bool:
    """Whether a job reads a file whose library may end the process."""
    return any(may_end_process(path) for path in job.data if is_path(path))


def _outcomes(run: _Run, jobs: Iterable[Job], workers: Workers) -> Iterator[tuple[Job, Outcome]]:
    with pool_of(workers) as pool:
        yield from run_many(run, map(_checked, jobs), pool, apart=may_end)


def _counted(
    outcomes: Iterator[tuple[Job, Outcome]], total: int | None, progress: Progress | None
) -> Iterator[tuple[Job, Outcome]]:
    for done, outcome in enumerate(outcomes, 1):
        if progress is not None:
            progress(done, total)
        yield outcome


def _checked(job: Job) -> Job:
    if not isinstance(job, Job):
        raise TypeError(f"jobs must hold objects of nonsac.Job, got {type(job).__name__}")
    job.compile()
    return job


# --- files ---------------------------------------------------------------------------------


def is_path(part: Any) -> bool:
    """Whether data are in a file of this name."""
    return isinstance(part, (str, os.PathLike))


def _read(call: Call, paths: tuple[Any, ...], settings: dict[str, Any]) -> tuple[Any, ...]:
    """What the call takes first; cameras of the files go into the settings, and the names of images leave them."""
    from nonsac.io import open_matches, read_cloud

    if call.layout is None:
        return tuple(map(read_cloud, paths))
    opened = open_matches(call.layout, paths, [settings.pop(name, None) for name in call.images])
    cameras = chosen_cameras([settings.get(name) for name in call.cameras], opened.cameras)
    settings.update(zip(call.cameras, cameras, strict=False))
    if settings.get("weights") is None:
        return (opened.source,)
    chunks = opened.source.chunks(2**20)  # weights given besides replace those of the file
    return call.layout.parts(np.concatenate([np.empty((0, opened.source.width)), *chunks]))
