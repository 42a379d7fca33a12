"""Many trials in processes, and a journal: a line of JSON for each outcome, from which a run that was stopped goes on.

A study is a dataclass that has `tasks` and can be called with the number of one; its outcomes are dataclasses of what
JSON can hold, with `trusted` and `right`. Both travel to other processes.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from common import say

from nonsac.running.executors import Workers, ordered_map


@dataclass(frozen=True)
class Single:
    """One task of a study, which travels without the others."""

    study: Any

    def __call__(self, number: int) -> Any:
        return self.study(0)


def part(study: Any, first: int, last: int | None = None) -> Any:
    """The study of some of its tasks."""
    return replace(study, tasks=study.tasks[first:last])


def run(study: Any, kind: type, workers: int, journal: Path | None, settings: Mapping[str, Any]) -> list[Any]:
    """All outcomes, which are of this kind, in the order of the tasks; first those that the journal holds."""
    outcomes = [kind(**line) for line in finished(journal, settings)]
    waiting = part(study, len(outcomes))
    with pool(workers, waiting) as processes:
        packed = (lambda number: Single(part(waiting, number, number + 1))) if workers > 1 else None
        for outcome in ordered_map(waiting, len(waiting.tasks), processes, packed):
            outcomes.append(outcome)
            keep(journal, asdict(outcome))
            if len(outcomes) % 50 == 0 or (outcome.trusted and not outcome.right):
                say(f"{len(outcomes)} of {len(study.tasks)}: {outcome}")
    return outcomes


@contextmanager
def pool(workers: int, study: Any) -> Iterator[Workers]:
    """Processes, once the kernels have been compiled for all of them."""
    if workers == 1:
        yield 1
        return
    for number in {task.group: number for number, task in enumerate(study.tasks)}.values():
        study(number)
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as processes:
        yield processes


def finished(journal: Path | None, settings: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What a run with the same settings has left; a journal that is not there is begun."""
    if journal is None or not journal.exists():
        keep(journal, settings)
        return []
    content = journal.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]  # the last line is torn where the run was killed
    os.truncate(journal, len(whole))
    lines = [json.loads(line) for line in whole.splitlines()]
    if not lines:
        keep(journal, settings)
    elif lines.pop(0) != json.loads(json.dumps(settings)):
        sys.exit(f"{journal.name} comes from other settings; remove it to start anew")
    return lines


def keep(journal: Path | None, content: Mapping[str, Any]) -> None:
    """Add a line to the journal."""
    if journal is not None:
        with journal.open("a") as file:
            file.write(json.dumps(content) + "\n")
