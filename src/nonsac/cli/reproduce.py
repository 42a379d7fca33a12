"""Run the paper's experiments."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from nonsac.cli.messages import to_stderr, to_stdout, wrote
from nonsac.cli.options import Quiet, Seed, Workers
from nonsac.cli.outputs import Outputs
from nonsac.cli.session import session


class ProblemName(StrEnum):
    """Choices of --problem; the experiments themselves are not imported for `--help`."""

    relative_pose = "relative-pose"
    absolute_pose = "absolute-pose"
    registration = "registration"
    all = "all"


_MOST_SAMPLES = 1000  # all their rows are in memory at once

Problem = Annotated[ProblemName, typer.Option("--problem", help="Which of the three problems.")]
Trials = Annotated[int, typer.Option(min=1, help="The paper has 100.")]
Processes = Annotated[int | None, typer.Option(min=1, show_default="all cores", help="Number of processes.")]
Report = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write all numbers as JSON; '-' is stdout.")
]
Resume = Annotated[bool, typer.Option("--resume", help="Go on where a run with the same --json FILE was stopped.")]


def table3(
    cloud: Annotated[Path, typer.Option(metavar="FILE", help="The bunny (bun_zipper.ply), or another cloud.")],
    trials: Trials = 100,
    seed: Seed = 0,
    workers: Workers = None,
    json_file: Report = None,
    picture: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw Fig. 2 (.png, .pdf or .svg).")] = None,
    quiet: Quiet = False,
) -> None:
    """Registration without correspondences: the paper's rules, and our own pipeline, on 250,000 hypothesised pairs."""
    files = Files(json_file, picture, quiet)
    files.check(("--cloud", cloud))
    with session(quiet, "trials") as progress:
        from nonsac.reproduce import table3 as experiment

        report = experiment.run(cloud, trials, seed, workers, progress)
    files.deliver(report, lambda: experiment.tables(report), experiment.picture)


def table2(
    problem: Problem = ProblemName.all,
    samples: Annotated[
        list[int] | None,
        typer.Option(
            min=1, max=_MOST_SAMPLES, show_default="10 20 30", help="Numbers of samples to compare: --samples 10 20 30."
        ),
    ] = None,
    more_samples: Annotated[
        list[int] | None, typer.Argument(min=1, max=_MOST_SAMPLES, metavar="--samples", hidden=True)
    ] = None,
    trials: Trials = 100,
    seed: Seed = 0,
    workers: Processes = None,
    json_file: Report = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the table, the errors and the times (.png, .pdf or .svg).")
    ] = None,
    literal: Annotated[
        bool,
        typer.Option(
            "--literal", help="As the text has it: cameras that see all points, plain Sampson, sums as ranks."
        ),
    ] = False,
    resume: Resume = False,
    quiet: Quiet = False,
) -> None:
    """All scoring rules on three simulated problems, over outlier ratios and noise levels."""
    if more_samples and not samples:
        raise typer.BadParameter(f"unexpected argument {more_samples[0]}; numbers of samples follow --samples")
    files = Files(json_file, picture, quiet)
    files.check()
    journal = files.journal(resume)
    with session(quiet, "trials") as progress:
        from nonsac.reproduce import pictures
        from nonsac.reproduce import table2 as experiment

        names = _names(problem)
        counts = (samples or []) + (more_samples or []) or experiment.PAPER_COUNTS
        report = experiment.run(names, counts, trials, seed, workers, progress, journal, resume, literal)
    files.deliver(report, lambda: [experiment.table(report, name) for name in names], pictures.table2)
    _forget(journal)


def section5(
    problem: Problem = ProblemName.all,
    trials: Trials = 100,
    seed: Seed = 0,
    workers: Processes = None,
    json_file: Report = None,
    picture: Annotated[Path | None, typer.Option(metavar="FILE", help="Draw the curves (.png, .pdf or .svg).")] = None,
    resume: Resume = False,
    quiet: Quiet = False,
) -> None:
    """What the number of samples and their size do to each scoring rule."""
    files = Files(json_file, picture, quiet)
    files.check()
    journal = files.journal(resume)
    with session(quiet, "trials") as progress:
        from nonsac.reproduce import pictures
        from nonsac.reproduce import section5 as experiment

        names = _names(problem)
        report = experiment.run(names, trials, seed, workers, progress, journal, resume)
    curves = [(name, curve) for name in names for curve in ("samples", "sample_size")]
    files.deliver(report, lambda: [experiment.table(report, *curve) for curve in curves], pictures.section5)
    _forget(journal)


def _forget(journal: Path | None) -> None:
    """Its content is in the report now."""
    if journal is not None:
        journal.unlink(missing_ok=True)


def _names(problem: ProblemName) -> list[str]:
    return [name.value for name in ProblemName if name is not ProblemName.all and problem in (name, ProblemName.all)]


@dataclass(frozen=True)
class Files:
    """Where a report goes: to the screen as tables, or as JSON to stdout; into files besides."""

    json_file: Path | None
    picture: Path | None
    quiet: bool = False

    @property
    def to_stdout(self) -> bool:
        return self.json_file == Path("-")

    @property
    def report(self) -> Path | None:
        return None if self.to_stdout else self.json_file

    def check(self, *inputs: tuple[str, Path]) -> None:
        Outputs(picture=self.picture, report=self.report).check(inputs)

    def journal(self, resume: bool) -> Path | None:
        """Beside the report."""
        if self.report is not None:
            journal = self.report.with_name(self.report.name + ".partial")
            if resume and not journal.exists():
                to_stderr(f"nothing to resume at {journal}: starting anew")
            return journal
        if resume:
            problem = "needs --json FILE, beside which finished trials are kept"
            raise typer.BadParameter(problem, param_hint="'--resume'")
        return None

    def deliver(
        self, report: dict[str, Any], tables: Callable[[], Iterable[object]], draw: Callable[..., None]
    ) -> None:
        text = json.dumps(report, indent=1, allow_nan=False)
        if self.to_stdout:
            to_stdout(text)
        else:
            import rich

            rich.print(*tables())
        if self.report is not None:
            from nonsac.files.atomic import write_atomically

            write_atomically(self.report, lambda temporary: temporary.write_text(text + "\n", encoding="utf-8"))
            wrote(self.report, "all numbers", self.to_stdout or self.quiet)
        if self.picture is not None:
            draw(self.picture, report)
            wrote(self.picture, "the picture", self.to_stdout or self.quiet)
