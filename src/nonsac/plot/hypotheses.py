"""What came of each sample, which one was selected, and where the answer is: the paper's Fig. 1 on one's own data."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nonsac.plot.figures import BLUE, INK, ORANGE, new_figure, only_ticks, picture_suffix, plain_axes, write, write_text
from nonsac.result import Hypothesis, Result
from nonsac.values.numeric import shown
from nonsac.values.quiet import quiet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]

_NEAREST = 0.01  # degrees
_TICKS = (0.01, 0.1, 1.0, 10.0, 100.0)
_FEWEST_PLACES = 10
_PALE = tuple(0.45 * BLUE + 0.55)
_POINT: dict[str, Any] = {"markeredgecolor": BLUE, "markersize": 7}
_STEPS = [digit * 10**power for power in range(9) for digit in (1, 2, 5)]


@quiet
def hypotheses(path: str | os.PathLike[str], result: Result, title: str | None = None) -> None:
    """Draw the hypotheses of a run: their scores and their distances from the selected one, and the inliers of each.

    Left, the score of each hypothesis against its distance from the selected one, which is drawn at 0.01 degrees, as
    all that is nearer; the vertical line is the answer, after refinement. Right, the share of inliers that each
    hypothesis has in its own sample, at its own threshold; the line is the share that the answer has in all rows it
    was tested on, and the band holds 95 % of samples that are drawn from such rows (Lee, Vandewalle and Civera,
    Sec. 3.1). Samples are numbered as `result.hypotheses` are, from 0; those without a model are crosses.

    Parameters
    ----------
    path : path-like
        The picture to write: .png (2100 x 900 pixels), .pdf or .svg.
    result : Result
        Of any call.
    title : str, optional
        A line above; by default what was selected, and whether the answer is trusted.

    Raises
    ------
    TypeError, ValueError
        If it is no result of a call, or the suffix is another.
    ImportError
        If matplotlib is missing.
    """
    suffix = picture_suffix(path)
    if not isinstance(result, Result) or result.evidence is None:
        raise TypeError(f"result must be the Result of a call, such as nonsac.relative_pose, got {shown(result)}")
    if title is not None and not isinstance(title, str):
        raise TypeError(f"title must be a string, got {shown(title)}")
    figure = new_figure(14.0, 6.0)
    left, right = figure.add_axes((0.07, 0.14, 0.42, 0.68)), figure.add_axes((0.56, 0.14, 0.42, 0.68))
    winner = selected(result)
    _draw_scores(left, result, winner)
    _draw_shares(right, result, winner)
    left.set_title("Scores of the hypotheses", loc="left", color=INK, fontsize=13)
    right.set_title("Inliers in each sample", loc="left", color=INK, fontsize=13)
    write_text(figure, 0.5, 0.95, _told(result, winner) if title is None else title, 14, parse_math=False)
    write(path, figure, suffix)


def selected(result: Result) -> int | None:
    """Number of the hypothesis that the scoring rule selected; None if none has a model."""
    scores = [h.score if h.found else -np.inf for h in result.hypotheses]
    found = any(h.found for h in result.hypotheses)
    return int(np.argmax(np.nan_to_num(scores, nan=-np.inf))) if found else None


def _told(result: Result, winner: int | None) -> str:
    count = len(result.hypotheses)
    samples = f"{count:,} {'sample' if count == 1 else 'samples'} of {result.info.get('sample_size', 0):,} rows"
    chosen = "no model" if winner is None else f"sample {winner} selected"
    verdict = "trusted" if result.success else f"NOT TRUSTED: {result.status.replace('_', ' ')}"
    return f"{samples}, {chosen}, {verdict}"


def _draw_scores(axes: Axes, result: Result, winner: int | None) -> None:
    plain_axes(axes)
    axes.set_xlabel("degrees from the selected one", color=INK)
    axes.set_ylabel(f"score ({result.info.get('rule', 'as given')})", color=INK, parse_math=False)
    if winner is None:
        axes.set_xticks([])
        axes.set_yticks([])
        what = "no sample gave a model" if result.hypotheses else "no sample was drawn"
        axes.text(0.5, 0.5, what, transform=axes.transAxes, ha="center", va="center", color=INK, fontsize=12)
        return
    found = [h for h in result.hypotheses if h.found]
    distances, scores = _distances(result, found, winner), np.array([h.score for h in found])
    scored, own = np.isfinite(scores), np.array([h is result.hypotheses[winner] for h in found])
    axes.set_xscale("log")
    others = scored & ~own
    if others.any():
        axes.plot(distances[others], scores[others], "o", label="others", **_POINT, color=_PALE)
    if not scored.all():  # as with rules that choose among a few
        bottom = np.full((~scored).sum(), 0.02)
        place = axes.get_xaxis_transform()
        axes.plot(
            distances[~scored], bottom, "o", label="out of the question", **_POINT, color="white", transform=place
        )
    axes.plot(distances[own], scores[own], "o", color=BLUE, markersize=11, label="selected", zorder=4)
    if result.found:
        answer = _distances(result, [result.model], winner)
        axes.axvline(float(answer[0]), color=ORANGE, linewidth=2.0, label="the answer", zorder=1)
    axes.set_xlim(0.8 * _NEAREST, 230.0)
    axes.margins(y=0.12)
    only_ticks(axes, "x", _TICKS)
    axes.legend(fontsize=9, frameon=False, labelcolor=INK, loc="best")


def _distances(result: Result, models: list[Hypothesis] | list[Floats], winner: int) -> Floats:
    """How far models are from the selected one, in degrees, as they are drawn."""
    assert result.evidence is not None
    stacked = np.stack([each.model if isinstance(each, Hypothesis) else each for each in models])
    distances = result.evidence.problem.distance(stacked, result.hypotheses[winner].model[None])
    return np.clip(np.nan_to_num(distances, nan=180.0), _NEAREST, None)


def _draw_shares(axes: Axes, result: Result, winner: int | None) -> None:
    plain_axes(axes)
    count = len(result.hypotheses)
    places, found = np.arange(count), np.array([h.found for h in result.hypotheses], bool)
    shares = np.array([100.0 * h.num_inliers / max(len(h.residuals), 1) for h in result.hypotheses])
    axes.bar(places, shares, 0.8, color=[BLUE if place == winner else _PALE for place in places], zorder=2)
    highest = float(shares.max(initial=0.0))
    if result.found and result.num_rows:
        share, rows = result.inlier_ratio, max((len(h.residuals) for h in result.hypotheses), default=1)
        spread = 196.0 * np.sqrt(share * (1.0 - share) / max(rows, 1))
        low, high = max(100.0 * share - spread, 0.0), 100.0 * share + spread
        axes.axhspan(low, high, color=ORANGE, alpha=0.15, zorder=0, linewidth=0, label=f"95 % of samples of {rows:,}")
        axes.axhline(100.0 * share, color=ORANGE, linewidth=2.0, zorder=3, label="the answer, in all rows")
        highest = max(highest, high)
    if not found.all():
        crosses: dict[str, Any] = {"color": 0.8 * ORANGE, "markersize": 7, "clip_on": False, "zorder": 5}
        axes.plot(places[~found], np.zeros((~found).sum()), "x", label="no model", **crosses)
    axes.set_xlim(-0.6, max(count, _FEWEST_PLACES) - 0.4)
    axes.set_ylim(0.0, 1.25 * highest or 1.0)
    only_ticks(axes, "x", range(0, count, next(step for step in _STEPS if count <= 10 * step)))
    axes.set_xlabel("sample", color=INK)
    axes.set_ylabel("inliers in it, %", color=INK)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=9, frameon=False, labelcolor=INK, loc="upper right", ncols=3)
