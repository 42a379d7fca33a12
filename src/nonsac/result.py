"""What comes back: a hypothesis per sample, and one result per call."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nonsac.layouts import Array, Rows
from nonsac.values.checks import real_array
from nonsac.values.quiet import quiet

_CHUNK = 8192


class Status(StrEnum):
    """Why an answer is trusted, or why it is not. `explanation` is the sentence for a person."""

    OK = "ok"
    TOO_FEW = "too_few"
    DEGENERATE = "degenerate"
    LOW_SUPPORT = "low_support"
    AMBIGUOUS = "ambiguous"
    UNCERTAIN = "uncertain"
    TIME_LIMIT = "time_limit"

    @property
    def explanation(self) -> str:
        return _EXPLANATIONS[self]


_EXPLANATIONS = {
    Status.OK: "the data support this answer, and no clearly different one does as well",
    Status.TOO_FEW: "there are too few distinct rows or points to determine an answer",
    Status.DEGENERATE: "the data do not determine an answer (identical or collinear points, or no baseline)",
    Status.LOW_SUPPORT: "no answer has more support than chance, or than a partly correct answer, would have",
    Status.AMBIGUOUS: "clearly different answers fit the data about equally well (see alternatives)",
    Status.UNCERTAIN: "the data leave the answer more uncertain than is allowed (see uncertainty, max_uncertainty)",
    Status.TIME_LIMIT: "the time limit was reached before there was an answer to be trusted",
}


class Remark(StrEnum):
    """What a result may say about the data besides its status. `explanation` is the sentence for a person.

    `info["remarks"]` holds these, with a detail after a colon if there is one, and the names of a problem's own special
    cases.
    """

    PLANAR = "planar"
    PURE_ROTATION = "pure rotation"
    PARTLY_RIGHT = "partly right"
    SLIPPING = "slipping"
    NOISE_LARGER = "noise is larger than given"
    NOISE_SMALLER = "noise is smaller than given"
    NOT_FITTED_TO_ALL = "not fitted to all rows"
    ESTIMATOR_FAILED = "the estimator failed in some samples"
    COPIES = "rows are equal to others"
    BLOCKS_DIFFER = "the rows of a block are alike"
    MIRRORED = "mirrored"
    OTHER_IMAGE = "points do not lie about the image of the camera"
    SIZES_DIFFER = "the clouds differ in size"

    @property
    def explanation(self) -> str:
        return _REMARKS[self]

    def detailed(self, detail: str) -> str:
        """The remark with what there is to say of this case."""
        return f"{self}: {detail}"


_REMARKS = {
    Remark.PLANAR: "all inliers lie near one plane, which may allow a second pose",
    Remark.PURE_ROTATION: "a rotation without a baseline explains all inliers, so that the translation means nothing",
    Remark.PARTLY_RIGHT: "parts of the inliers ask for different models, or they are spread over the threshold",
    Remark.SLIPPING: "models beside the answer explain many rows that it does not, or the noise is larger than given",
    Remark.NOISE_LARGER: "the inliers show more noise than was given, by a factor of three or more",
    Remark.NOISE_SMALLER: "the inliers show less noise than was given, by a factor of three or more",
    Remark.NOT_FITTED_TO_ALL: "the answer is the one fitted to some rows",
    Remark.ESTIMATOR_FAILED: "the core estimator raised an exception; these samples count as empty",
    Remark.COPIES: "rows equal to more than three others count once, as padding and missing measurements should",
    Remark.BLOCKS_DIFFER: 'the file is sorted or grouped, and some blocks do not stand for it; use draw="rows"',
    Remark.MIRRORED: "one image looks like a mirror image of the other, or its x and y are exchanged",
    Remark.OTHER_IMAGE: "was an image resized, are x and y exchanged, or is it another camera's",
    Remark.SIZES_DIFFER: "one cloud is at least three times as large as the other, and no scale is estimated",
}


@dataclass(frozen=True)
class Uncertainty:
    """How far an answer may be off: 95 % of errors are less, if the inliers are true and their errors independent.

    Attributes
    ----------
    rotation : float
        Angle, in degrees.
    translation : float
        Of a relative pose the angle of its direction, in degrees; otherwise a length, in the unit of the target or the
        world.
    angle : float
        The translation as an angle, in degrees: as it shows from the middle of the scene (camera poses), or as a turn
        by it would (registrations, as a share of the extent). It is bounded by twice `max_uncertainty`, and the
        rotation by `max_uncertainty`.
    """

    rotation: float
    translation: float
    angle: float

    def within(self, degrees: float) -> float:
        """How large it is, as a share of what is allowed."""
        return max(self.rotation, 0.5 * self.angle) / degrees

    def times(self, factor: float) -> Uncertainty:
        """A multiple of it."""
        return Uncertainty(factor * self.rotation, factor * self.translation, factor * self.angle)


class FailedEstimation(RuntimeError):
    """Raised by `Result.raise_if_failed` if the answer is not to be trusted."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One model, found in one sample.

    Attributes
    ----------
    model : float64
        In the problem's own shape, `[s R | t]` (3, 4) for motions; NaN if the sample gave none.
    residuals : (N,) float64
        Of the sample's own rows, in the unit of `threshold`.
    threshold : float
        Rows with a smaller residual are inliers.
    sample : int
        Which sample it was found in.
    alternatives : sequence of models
        Further models that the estimator found worth a look, best first.
    tested : int or None
        How many candidate models the estimator compared before it chose this one; None if it does not say.
    promising : Rows or None
        Rows of the sample that the estimator takes for the most likely inliers, for a joint search.
    rank_scores : (P,) float64
        How likely it takes them, comparable between samples of the same size.
    dropped : int
        Rows of the sample that were left out because they were not finite.
    log_chance : float
        Logarithm of a bound for the chance of a model as good among wrong rows, if the threshold was found with it; 0
        if it was not.
    score : float
        What the scoring rule gave it; higher is better.
    fault : str
        Why the estimator gave no model, if it failed: the exception that it raised, say.
    """

    model: Array
    residuals: Array
    threshold: float
    sample: int = 0
    alternatives: Array | tuple[()] = ()
    promising: Rows | None = None
    rank_scores: Array = field(default_factory=lambda: np.empty(0))
    tested: int | None = None
    dropped: int = 0
    log_chance: float = 0.0
    score: float = float("nan")
    fault: str = ""

    @property
    def found(self) -> bool:
        return bool(np.isfinite(self.model).all())

    @property
    def num_inliers(self) -> int:
        return int(np.count_nonzero(self.residuals < self.threshold))

    @property
    def inlier_residuals(self) -> Array:
        return self.residuals[self.residuals < self.threshold]


@dataclass(frozen=True, eq=False)
class Alternative:
    """A clearly different answer that the data support next best.

    Attributes
    ----------
    model : float64
        In the problem's own shape.
    support : float
        Share of the rows (or points) that support it.
    T : (4, 4) float64 or None
        The model as a matrix, if it is a motion.
    """

    model: Array
    support: float
    T: Array | None = None


@dataclass(frozen=True, eq=False)
class Evidence:
    """The problem that a result is of, and the source of its rows; None for raw clouds, which have no rows."""

    problem: Any
    source: Any = None

    def residuals(self, model: Array) -> Iterator[Array]:
        """Of every row of the source, in its order, some at a time: (k,) each; NaN for rows that are not finite."""
        for rows in self.source.chunks(_CHUNK):
            yield self._residuals_of(rows, model)

    @quiet
    def _residuals_of(self, rows: Array, model: Array) -> Array:
        finite = np.isfinite(rows).all(axis=1)
        residuals = np.full(len(rows), np.nan)
        residuals[finite] = self.problem.residuals(model[None], rows[finite, : self.problem.width])[0]
        return residuals


@dataclass(frozen=True, eq=False)
class Result:
    """The answer, and how far to trust it.

    Attributes
    ----------
    model : float64
        In the problem's own shape: `[s R | t]` (3, 4) for motions. NaN if nothing was found; if it is finite but
        `success` is false, it is the best guess.
    status : Status
        `Status.OK` or the reason why the answer is not to be trusted.
    confidence : float
        In [0, 1], 0.5 at the bound between trusted and not: the lesser of how certainly the support is no chance, and
        how certainly the answer is not right in part only; for raw clouds, how far the best other answer is behind.
        `docs/verdict.md` has both, and how often answers of each confidence were right.
    num_inliers, num_rows : int
        Rows (or points) that support the returned model, out of those that it was tested on.
    noise : float
        Standard deviation of an inlier, in the unit of the data: the one that was given, or the measured one at which
        the answer was found (`info["measured_noise"]` is what the answer shows in the end); for raw clouds that of the
        distance between the two surfaces.
    threshold : float
        Rows with a smaller residual than this are inliers, in the unit of the data.
    hypotheses : tuple of Hypothesis
        One for each sample, with its score.
    alternatives : tuple of Alternative
        Clearly different answers, best first.
    covariance : (6, 6), (7, 7) or (5, 5) float64, or None
        Of a rigid motion or an absolute pose: of the rotation vector w in radians, for which R becomes exp([w]x) R, and
        of t. If the scale was estimated, its logarithm is the seventh. Of a relative pose: of w and of the direction
        of t, in two axes of its tangent plane (`kernels.pose_math.tangents`). With points far from the origin t depends
        on w, and its variance is large. None if nothing was found, for raw clouds, and if rows have weights.

        It comes from the residuals themselves, whatever the noise was said to be. In simulations the mean of
        e^T C^-1 e / p, of errors e of p parameters, is 0.85 to 1.15 from ten inliers on, and with up to 90 % outliers
        from fifty on; 1 would be exact. Relative poses are the limit: 1.25 with 20 inliers and 90 % outliers, 1.3 with
        200 inliers and 97 %, because a few outliers that fit by chance, far from all inliers, decide much. Infinite
        if too few inliers are left to tell the noise (relative poses: seven or fewer).
    uncertainty : Uncertainty or None
        What the covariance means in degrees and lengths, with matches of one place counted once. None if `covariance`
        is.
    info : dict
        `seed`, `version`, `seconds` per stage, `samples`, `sample_size`, counts of dropped rows, `remarks` on special
        cases such as "planar", `tests` (what the verdict rests on, see docs/verdict.md), `passes` over all rows with
        refine="full", `peak_memory` of the process in bytes, ...
    evidence : Evidence
        The problem, and where `residuals` and `inliers` come from.
    """

    model: Array
    status: Status
    confidence: float
    num_inliers: int
    num_rows: int
    noise: float
    threshold: float
    hypotheses: tuple[Hypothesis, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    covariance: Array | None = None
    uncertainty: Uncertainty | None = None
    info: dict[str, Any] = field(default_factory=dict)
    evidence: Evidence | None = field(default=None, repr=False)

    @property
    def success(self) -> bool:
        return self.status is Status.OK

    @property
    def found(self) -> bool:
        """Whether there is a model at all, trusted or not."""
        return bool(np.isfinite(self.model).all())

    @property
    def remarks(self) -> tuple[str, ...]:
        """What there is to say of the data besides the status: `Remark`s, some with a detail after a colon."""
        return tuple(self.info.get("remarks", ()))

    @cached_property
    def T(self) -> Array:
        """The motion as a matrix (4, 4) that maps source to target, `[s R, t; 0, 1]`.

        NaN if nothing was found, never a made-up identity. A model that is no motion has no T.
        """
        T = self._evidence.problem.transform(self.model)
        if T is None:
            name = type(self._evidence.problem).__name__
            raise AttributeError(f"a model of {name} is no motion, so it has no T, R, t or scale: see result.model")
        return T if self.found else np.full((4, 4), np.nan)

    @property
    def is_motion(self) -> bool:
        """Whether the model is a motion of points, which has T, R, t and scale."""
        return self.evidence is not None and self.evidence.problem.transform(self.model) is not None

    @property
    def scale(self) -> float:
        """Factor of the lengths; NaN if nothing was found."""
        if not np.isfinite(self.T).all():
            return float("nan")
        return float(np.cbrt(np.linalg.det(self.T[:3, :3])))

    @property
    def R(self) -> Array:
        """Rotation matrix (3, 3)."""
        return self.T[:3, :3] / self.scale

    @property
    def t(self) -> Array:
        """Translation (3,), in the target's unit."""
        return self.T[:3, 3].copy()

    @property
    def rotation(self) -> Any:
        """The rotation as a `scipy.spatial.transform.Rotation`; raises `FailedEstimation` if nothing was found."""
        from scipy.spatial.transform import Rotation

        if not np.isfinite(self.T).all():
            raise FailedEstimation(f"{self.status}: {self.status.explanation}")
        return Rotation.from_matrix(self.R)

    @cached_property
    def residuals(self) -> Array:
        """Residual of every row of the input for the returned model, in input order (n,), in the unit of `threshold`.

        Computed when first asked for, in one pass over all rows. NaN for rows that are not finite, and for all if
        nothing was found.
        """
        return np.concatenate([np.empty(0), *self._residuals_by_chunk()])

    @property
    def inliers(self) -> NDArray[np.bool_]:
        """Which rows of the input are inliers of the returned model, in input order (n,)."""
        with np.errstate(invalid="ignore"):
            return self.residuals < self.threshold

    def write_inliers(self, path: str | Path) -> None:
        """Write which rows of the input are inliers, in input order, in memory that does not grow with their number.

        Parameters
        ----------
        path : str or Path
            .npy holds an array of bool (n,); .txt and .csv hold a line of 0 or 1 for each row.

        Raises
        ------
        InputError
            If the name has another suffix, or the file cannot be written; nothing is left then.
        """
        from nonsac.files.masks import write_mask

        pieces = (residuals < self.threshold for residuals in self._residuals_by_chunk())
        write_mask(path, pieces, len(self._rows().source))

    def _residuals_by_chunk(self) -> Iterator[Array]:
        return self._rows().residuals(self.model)

    @property
    def _evidence(self) -> Evidence:
        if self.evidence is None:
            raise AttributeError("this result was made by hand, without the problem that it is of")
        return self.evidence

    def _rows(self) -> Evidence:
        if self._evidence.source is None:
            raise AttributeError("there are no rows to give residuals of: the data were raw clouds")
        return self._evidence

    @property
    def inlier_ratio(self) -> float:
        return self.num_inliers / self.num_rows if self.num_rows else 0.0

    def apply(self, points: Array) -> Array:
        """Map source points (n, 3) into the target frame."""
        rows = real_array("points", points)
        if rows.ndim != 2 or rows.shape[1] != 3:
            raise ValueError(f"points has shape {rows.shape}; expected (n, 3)")
        with np.errstate(all="ignore"):
            return rows @ self.T[:3, :3].T + self.T[:3, 3]

    def raise_if_failed(self) -> Result:
        """Return the result itself, or raise `FailedEstimation` if it is not to be trusted."""
        if not self.success:
            raise FailedEstimation(f"{self.status}: {self.status.explanation}")
        return self

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, strings and lists; NaN becomes None, so that the JSON is valid everywhere."""
        return {
            "success": self.success,
            "status": str(self.status),
            "explanation": self.status.explanation,
            "confidence": self.confidence,
            **({"T": _plain(self.T), "scale": _plain(self.scale)} if self.is_motion else {"model": _plain(self.model)}),
            "num_inliers": self.num_inliers,
            "num_rows": self.num_rows,
            "inlier_ratio": self.inlier_ratio,
            "noise": _plain(self.noise),
            "threshold": _plain(self.threshold),
            "covariance": _plain(self.covariance),
            "uncertainty": None if self.uncertainty is None else _plain(asdict(self.uncertainty)),
            "alternatives": [
                {"T": _plain(a.T), "support": _plain(a.support)}
                if a.T is not None
                else {"model": _plain(a.model), "support": _plain(a.support)}
                for a in self.alternatives
            ],
            "hypotheses": [
                {
                    "sample": h.sample,
                    "model": _plain(h.model),
                    "num_inliers": h.num_inliers,
                    "score": _plain(h.score),
                }
                for h in self.hypotheses
            ],
            "info": {key: _plain(value) for key, value in self.info.items()},
        }

    def to_json(self, indent: int | None = None) -> str:
        return json.dumps(self.to_dict(), indent=indent, allow_nan=False)

    def save(self, path: str | Path) -> None:
        """Write the JSON of `to_json` to a file, whole or not at all."""
        from nonsac.files.atomic import write_atomically

        text = self.to_json(indent=1) + "\n"
        write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))

    def _described_model(self) -> str:
        if not self.is_motion:
            return "a model" if self.evidence is None else str(self.evidence.problem.describe(self.model))
        angle = np.degrees(self.rotation.magnitude())
        t = ", ".join(f"{x:.6g}" for x in self.t)
        return f"rotation {angle:.3f} deg, translation [{t}], scale {self.scale:.6g}"

    def __repr__(self) -> str:
        if not self.found:
            return "\n".join([f"Result({self.status}: {self.status.explanation})", *self._told_remarks()])
        lines = [
            f"Result({self.status}, confidence {self.confidence:.3f})",
            f"  {self._described_model()}",
            f"  inliers {self.num_inliers} of {self.num_rows} ({100 * self.inlier_ratio:.3g} %), "
            f"noise {self.noise:.4g}",
            *self._told_uncertainty(),
            f"  {len(self.hypotheses)} hypotheses, {len(self.alternatives)} alternatives",
        ]
        lines += self._told_remarks()
        return "\n".join(lines if self.success else [*lines, f"  {self.status.explanation}"])

    def _told_uncertainty(self) -> list[str]:
        known = self.uncertainty
        if known is None:
            return []
        unit = " deg" if known.translation == known.angle else ""  # of a direction
        return [f"  95 % within {known.rotation:.2g} deg of rotation, {known.translation:.2g}{unit} of translation"]

    def _told_remarks(self) -> list[str]:
        return [f"  remark: {remark}" for remark in self.remarks]


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def failed(
    status: Status,
    evidence: Evidence,
    info: dict[str, Any],
    noise: float = float("nan"),
    threshold: float = float("nan"),
    hypotheses: tuple[Hypothesis, ...] = (),
) -> Result:
    """A result without an answer."""
    nothing = evidence.problem.no_model
    return Result(nothing, status, 0.0, 0, 0, noise, threshold, hypotheses, info=info, evidence=evidence)
