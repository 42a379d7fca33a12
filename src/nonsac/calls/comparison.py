"""What a comparison of methods came to."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nonsac.files.atomic import write_atomically
from nonsac.files.errors import FilePath, input_error

if TYPE_CHECKING:
    from rich.table import Table

OK, NOT_INSTALLED = "ok", "not installed"
NEARLY_AS_GOOD, _AS_GOOD = 0.9, 1.01
_OFTEN_ENOUGH, _APART, _NEAR = 0.5, 5.0, 1.0  # of the runs; degrees
_RIGHT = 0.3  # mAA
_NOBODY, _WIDTH, _SHORT, _LEAST_ANGLE = "take none: ", 160, 48, 0.001


@dataclass(frozen=True)
class Compared:
    """One method, used in one way.

    Attributes
    ----------
    method : str
        The name of the core estimator.
    use : str
        "alone", on one sample without NONSAC; "core", as the core of the method; or the rule that selects.
    sample_size, samples : int or None
        The paper's N and m; None if the method chooses.
    noise : float or None
        At which it was run, in the unit of the residual.
    outcome : str
        "ok" (there may be no answer, see `status`), "out of memory", "over the time limit", "crashed", "failed" or
        "not installed".
    detail : str
        What is known of an outcome that is not ok.
    runs, repeats : int
        How many runs ended, of how many.
    accuracy : float or None
        With a truth: mAA over the repeats up to 10 degrees (`nonsac.evaluation`) of the larger error, of rotation or
        of translation; that of a motion of points is how far they are off, seen over the extent of the scene.
    rotation_error, translation_error : float or None
        Medians: degrees, and of a relative pose the angle of the direction of t in degrees, else its length.
    held_out : float or None
        Share of the rows that no method saw that fit the answer beyond chance, in the mean over the repeats.
    agreement : float or None
        Degrees from the answer that most of the methods support; the median.
    trusted : float or None
        Share of the repeats that our verdict trusts.
    status : str or None
        The most frequent one of our verdict.
    confidence : float or None
        Median.
    merit : float
        What it is ranked by: `accuracy`, or without a truth `held_out` of the runs that are trusted, 0 for the others.
    seconds, cpu_seconds : float or None
        Medians, without the first call.
    peak_memory : int or None
        Bytes beside what the process held before, the most of all runs.
    """

    method: str
    use: str
    sample_size: int | None = None
    samples: int | None = None
    noise: float | None = None
    outcome: str = OK
    detail: str = ""
    runs: int = 0
    repeats: int = 0
    accuracy: float | None = None
    rotation_error: float | None = None
    translation_error: float | None = None
    held_out: float | None = None
    agreement: float | None = None
    trusted: float | None = None
    status: str | None = None
    confidence: float | None = None
    merit: float = 0.0
    seconds: float | None = None
    cpu_seconds: float | None = None
    peak_memory: int | None = None

    @property
    def name(self) -> str:
        """What was run, in words."""
        words = {"alone": f"{self.method} alone", "core": f"{self.method} as the core of NONSAC"}
        told = words.get(self.use, f"the rule {self.use} over {self.method}")
        if self.samples is not None:
            told += f" with m = {self.samples}"
        return told if self.sample_size is None else f"{told} on samples of {self.sample_size:,} rows"


@dataclass(frozen=True)
class Comparison:
    """Methods compared on the same data.

    Attributes
    ----------
    call : str
        The call that the data are for, or the class of the problem.
    rows : tuple of Compared
        Best first; those that gave nothing last.
    num_rows, num_held_out : int
        Rows of the data, and those that all methods were judged on and none saw.
    noise : float or None
        At which rows were judged: those within 5 of it fit. None if nothing could be measured.
    truth : bool
        Whether the truth was known.
    seed : int
    remarks : tuple of str
        What else is to be said.
    version : str
        Of nonsac.
    by_rule : bool
        Whether rules were compared.
    default_held_out : float or None
        Share of the held-out rows that fit the answer of the default method, which measured the noise, if it is to be
        trusted.
    """

    call: str
    rows: tuple[Compared, ...]
    num_rows: int
    num_held_out: int
    noise: float | None
    truth: bool
    seed: int
    remarks: tuple[str, ...] = ()
    version: str = ""
    by_rule: bool = field(default=False)
    default_held_out: float | None = None

    @property
    def best(self) -> Compared | None:
        """The one to take: of those that are the best or within 10 % of it, the one that takes least CPU time.

        None if none is right (with a truth: an mAA above .3), or trusted in half of its runs at least, or if the
        default method explains clearly more of the rows.
        """
        least = _RIGHT if self.truth else 0.0
        usable = [row for row in self.rows if row.merit > least and row.use != "ideal"]
        if not usable:
            return None
        top = max(usable, key=lambda row: row.merit)
        if not self.truth and max(row.trusted or 0.0 for row in self.rows) < _OFTEN_ENOUGH:
            return None
        most = top.merit if self.truth else max(top.merit, self.default_held_out or 0.0)
        good = [row for row in usable if row.merit >= NEARLY_AS_GOOD * most]
        if not good:
            return None
        return min(good, key=lambda row: (math.inf if row.cpu_seconds is None else row.cpu_seconds, -row.merit))

    @property
    def recommendation(self) -> str:
        """What to take, in one sentence."""
        best = self.best
        if best is None:
            if all(row.outcome != OK for row in self.rows):
                return f"{_NOBODY}no method gave an answer on these data"
            if self.truth:
                return f"{_NOBODY}no method came near the truth in most of its runs{self._doubt_of_truth()}"
            merit = max((row.merit for row in self.rows), default=0.0)
            if merit > 0.0 and NEARLY_AS_GOOD * (self.default_held_out or 0.0) > merit:
                return (
                    f"{_NOBODY}the default method explains {_percent(self.default_held_out)} of the held-out rows, and "
                    f"none of these more than {_percent(merit)}"
                )
            return f"{_NOBODY}no method gave an answer to be trusted on these data"
        what = f"mAA {best.accuracy:.2f}" if self.truth else f"{_percent(best.held_out)} of the held-out rows fit"
        top = max((row for row in self.rows if row.use != "ideal"), key=lambda row: row.merit)
        told = f"take {best.name}: {what}, {_seconds(best.cpu_seconds)} of CPU time"
        if top.merit > _AS_GOOD * best.merit and top.cpu_seconds is not None:
            most = f"{top.accuracy:.2f}" if self.truth else _percent(top.merit)
            told += f"; the best is {top.name} ({most}, {_seconds(top.cpu_seconds)})"
        return told + self._distrust(best) + self._dissent(best)

    def _doubt_of_truth(self) -> str:
        """What is said if answers that are trusted agree with each other, and not with the truth."""
        agreeing = [row for row in self.rows if (row.trusted or 0.0) >= _OFTEN_ENOUGH and row.agreement is not None]
        close = [row for row in agreeing if row.agreement is not None and row.agreement < _NEAR]
        return (
            "; those that are trusted agree with each other: is it the truth, or its inverse?" if len(close) > 1 else ""
        )

    def _distrust(self, best: Compared) -> str:
        """What is said if our verdict does not trust what is right."""
        if best.trusted is None or best.trusted >= 1.0:
            return ""
        return f"; our verdict trusts {round(best.trusted * best.repeats)} of its {best.repeats} runs"

    def _dissent(self, best: Compared) -> str:
        """What is said of methods that are trusted, too, and give another answer."""
        others = [row for row in self.rows if (row.trusted or 0.0) >= _OFTEN_ENOUGH and row.agreement is not None]
        far = [row for row in others if row.agreement is not None and row.agreement > _APART]
        if self.truth or not far or best.agreement is None:
            return ""
        if best.agreement > _APART:
            return "; but most methods give another answer, look at both"
        worst = max(far, key=lambda row: row.agreement or 0.0)
        return f"; but {worst.name}, trusted as well, gives an answer {worst.agreement:.0f} degrees away"

    # --- as a table ------------------------------------------------------------------------

    def table(self) -> Table:
        """The rows, for `rich.print`; what is recommended is marked."""
        from rich.box import SIMPLE_HEAD
        from rich.table import Table
        from rich.text import Text

        columns = [column for column in _COLUMNS if self._is_shown(column)]
        table = Table(box=SIMPLE_HEAD, collapse_padding=True, title=self.title, title_justify="left")
        table.add_column("", no_wrap=True)
        for column in columns:
            table.add_column(column, justify="left" if column in _WORDS else "right", no_wrap=column != "outcome")
        best = self.best
        for row in self.rows:
            style = "bold" if row is best else ("dim" if row.outcome != OK else None)
            cells = (Text(_cell(column, row)) for column in columns)  # brackets are no markup
            table.add_row("*" if row is best else "", *cells, style=style)
        return table

    @property
    def title(self) -> str:
        """What was compared, in one line."""
        noise = "" if self.noise is None else f", judged at a noise of {self.noise:.3g}"
        held_out = f"{self.num_rows:,} rows, {self.num_held_out:,} of them held out"
        return f"{self.call.replace('_', '-')}: {held_out}{noise}"

    def _is_shown(self, column: str) -> bool:
        if column in ("mAA", "error", "t error"):
            return self.truth
        if column in ("rule", "m"):
            return self.by_rule
        if column in ("use", "agree", "trusted", "conf."):
            return not self.by_rule
        if column == "noise":
            return len({row.noise for row in self.rows if row.noise is not None}) > 1
        return True

    def __str__(self) -> str:
        from rich.console import Console

        written = io.StringIO()
        console = Console(file=written, width=_WIDTH, color_system=None, force_terminal=False)
        console.print(self.table())
        lines = [line.rstrip() for line in written.getvalue().splitlines()]
        return "\n".join([*lines, *(f"remark: {remark}" for remark in self.remarks), self.recommendation])

    def draw(self, path: FilePath) -> None:
        """Draw accuracy, or without a truth the share of held-out rows that fit, against CPU time.

        Parameters
        ----------
        path : path-like
            .png, .pdf or .svg.
        """
        from nonsac import plot

        rows = [row for row in self.rows if row.cpu_seconds is not None]
        best = self.best
        plot.comparison(
            path,
            [row.use if self.by_rule else row.method for row in rows],
            [f"m = {row.samples}" if self.by_rule else row.use for row in rows],
            [row.cpu_seconds or 0.0 for row in rows],
            [row.merit for row in rows],
            None if best is None else rows.index(best),
            "mAA (10 deg)" if self.truth else "held-out rows that fit a trusted answer",
            self.title,
        )

    # --- as JSON ---------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, strings and lists; what is not known is None."""
        held = {each.name: getattr(self, each.name) for each in fields(self) if each.name != "rows"}
        best = self.best
        return {
            **held,
            "remarks": list(self.remarks),
            "recommendation": self.recommendation,
            "best": None if best is None else self.rows.index(best),
            "rows": [asdict(row) for row in self.rows],
        }

    def to_json(self, indent: int | None = None) -> str:
        return json.dumps(self.to_dict(), indent=indent, allow_nan=False)

    def save(self, path: FilePath) -> None:
        """Write the JSON of `to_json` to a file, whole or not at all."""
        text = self.to_json(indent=1) + "\n"
        write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))

    @classmethod
    def load(cls, path: FilePath) -> Comparison:
        """Read what `save` wrote.

        Raises
        ------
        InputError
            If the file cannot be read, or holds something else.
        """
        from nonsac.files.content import check_regular

        check_regular(path)
        try:
            return cls.of(json.loads(Path(path).read_text(encoding="utf-8")))
        except (UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError, RecursionError):
            raise input_error(path, "the file holds no comparison", "write it with Comparison.save") from None

    @classmethod
    def of(cls, held: Mapping[str, Any]) -> Comparison:
        """What `to_dict` gave."""
        own = {each.name: held[each.name] for each in fields(cls)}
        rows = tuple(Compared(**row) for row in held["rows"])
        return cls(**own | {"rows": rows, "remarks": tuple(held["remarks"])})


_COLUMNS = (
    "method",
    "use",
    "rule",
    "m",
    "N",
    "noise",
    "mAA",
    "error",
    "t error",
    "held out",
    "agree",
    "trusted",
    "conf.",
    "CPU",
    "time",
    "memory",
    "outcome",
)
_WORDS = ("method", "use", "rule", "outcome")


def _cell(column: str, row: Compared) -> str:
    match column:
        case "method":
            return row.method
        case "use" | "rule":
            return row.use
        case "m":
            return "" if row.samples is None else f"{row.samples}"
        case "N":
            return "auto" if row.sample_size is None else f"{row.sample_size:,}"
        case "noise":
            return "" if row.noise is None else f"{row.noise:.3g}"
        case "mAA":
            return "" if row.accuracy is None else f"{row.accuracy:.2f}"
        case "error":
            return _degrees(row.rotation_error)
        case "t error":
            return "" if row.translation_error is None else f"{row.translation_error:.2g}"
        case "held out":
            return _percent(row.held_out)
        case "agree":
            return _degrees(row.agreement)
        case "trusted":
            return "" if row.trusted is None else f"{round(row.trusted * row.repeats)} of {row.repeats}"
        case "conf.":
            return "" if row.confidence is None else f"{row.confidence:.2f}"
        case "CPU":
            return _seconds(row.cpu_seconds)
        case "time":
            return _seconds(row.seconds)
        case "memory":
            return "" if row.peak_memory is None else _megabytes(row.peak_memory)
    return _outcome(row)


def _outcome(row: Compared) -> str:
    if row.outcome == OK:
        lost = row.repeats - row.runs
        status = "" if row.status in (None, "ok") else str(row.status).replace("_", " ")
        return status + (f" ({lost} of {row.repeats} runs lost: {row.detail[:_SHORT]})" if lost else "")
    return f"{row.outcome}: {row.detail[:_SHORT]}" if row.detail else row.outcome


def _degrees(angle: float | None) -> str:
    if angle is None:
        return ""
    return f"{angle:.0f} deg" if angle >= 10.0 else f"{max(angle, _LEAST_ANGLE):.2g} deg"


def _megabytes(memory: int) -> str:
    return "< 1 MB" if memory < 10**6 else f"{memory / 1e6:,.0f} MB"


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.1f} %"


def _seconds(seconds: float | None) -> str:
    if seconds is None:
        return ""
    return f"{1000 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"
