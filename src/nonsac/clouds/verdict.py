"""Whether the registration of two raw clouds is to be trusted."""

from __future__ import annotations

from collections.abc import Sequence

from nonsac.layouts import Array
from nonsac.method.verdict import Verdict
from nonsac.result import Status

_AGREEMENT = 0.75 * 8.0 / 15.0


def judge_overlap(
    shares: Sequence[float], agreement: float, support: float, others: Array, surfaces: bool = True
) -> Verdict:
    """Do enough points of two raw clouds coincide, wherever they meet, and do clearly fewer under any other answer?

    *Enough.* At least 15 % of each cloud's points must lie in the other's surface: a small piece of one meets much of
    the other by chance. Only if one lies in the other by half or more, as a part in a whole, that is enough.

    *Wherever they meet.* Surfaces that cross or touch come close in many more places than they coincide in. Points
    that are spread evenly over what is allowed have a mean weight of 8/15; three quarters of the points that come
    close to the other cloud must lie in it like this, or fewer that are nearer.

    *Clearly fewer.* The best clearly different answer must have less than 0.85 of the support; less is allowed below a
    share of 0.22, at which even unrelated clouds may meet.

    The confidence is the lesser one of the latter two, 0.5 at either bound. The bounds lie between right and wrong
    answers on real scans (`docs/verdict.md`).

    Parameters
    ----------
    shares : (2,) float
        Of both clouds' points, those that lie in the other cloud's surface.
    agreement : float
        Mean weight of the points that come close to the other cloud.
    support : float
        Weight of all points.
    others : (k,) float
        The same for clearly different answers, best first.
    surfaces : bool
        Whether both clouds are surfaces at all; if not, their normals and this comparison mean nothing.
    """
    share = max(shares) if max(shares) >= 0.5 else min(shares)
    if share < 0.15 or not surfaces:
        return Verdict(Status.LOW_SUPPORT, 0.0)
    meeting = _certainty_of_lead(_AGREEMENT, agreement, 8)
    allowed = 0.85 - 4.0 * max(0.0, 0.22 - share)
    lead = _certainty_of_lead(float(others[0]) / support if len(others) else 0.0, allowed, 4)
    confidence = min(meeting, lead)
    if confidence >= 0.5:
        return Verdict(Status.OK, confidence)
    return Verdict(Status.LOW_SUPPORT if meeting < 0.5 or share < 0.22 else Status.AMBIGUOUS, confidence)


def _certainty_of_lead(lesser: float, greater: float, power: int) -> float:
    """How certainly one is less than the other: 1 if it is nothing to it, 0.5 if they are equal."""
    if lesser <= greater:
        return 1.0 - 0.5 * (lesser / greater) ** power
    return 0.5 * (greater / lesser) ** power
