"""Which lens a camera model has."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from nonsac.cameras.closed_forms import division, enhanced_unified, equidistant, field_of_view
from nonsac.cameras.lens import Chain, Lens
from nonsac.cameras.polynomial import Polynomial


def lens_of(model: str, named: Mapping[str, float]) -> Lens | None:
    """The lens of a supported model, given its parameters by name; None if there is no distortion."""
    if model == "FOV":
        return field_of_view(named["omega"])
    if "DIVISION" in model:
        return division(named["k"])
    if model == "EUCM":
        return enhanced_unified(named["alpha"], named["beta"])
    if "FISHEYE" in model:
        bent = [equidistant(), *_polynomials(model, named, np.pi / 2)]
        return Chain(bent) if len(bent) > 1 else bent[0]
    return next(iter(_polynomials(model, named)), None)


def _polynomials(model: str, named: Mapping[str, float], within: float = np.inf) -> list[Polynomial]:
    """The polynomial distortions of a model, without those that change nothing."""
    radial = [value for name, value in named.items() if name.startswith("k")]
    if model == "RAD_TAN_THIN_PRISM_FISHEYE":  # what is tangential bends what the radial part has bent
        p, s, t = (complex(named[x], named[y]) for x, y in (("p0", "p1"), ("s0", "s2"), ("s1", "s3")))
        parts = [Polynomial(radial, within=within)] if any(radial) else []
        return [*parts, Polynomial(p=p, prism=(s, t))] if p or s or t else parts
    top, bottom = (radial[:3], radial[3:]) if model == "FULL_OPENCV" else (radial, [])
    p = complex(named.get("p2", 0.0), named.get("p1", 0.0))
    s = complex(named.get("sx1", 0.0), named.get("sy1", 0.0))
    return [Polynomial(top, bottom, p, (s, 0j), within)] if p or s or any(radial) else []
