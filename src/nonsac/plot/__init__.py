"""Pictures of results. They need matplotlib, but no display: all is drawn into memory, then written."""

from nonsac.plot.box_plots import boxplot
from nonsac.plot.comparisons import comparison
from nonsac.plot.figures import picture_suffix, render
from nonsac.plot.graphs import match_graph
from nonsac.plot.hypotheses import hypotheses
from nonsac.plot.images import epipolar_lines, matches, reprojections, two_views
from nonsac.plot.point_clouds import clouds

__all__ = [
    "boxplot",
    "clouds",
    "comparison",
    "epipolar_lines",
    "hypotheses",
    "match_graph",
    "matches",
    "picture_suffix",
    "render",
    "reprojections",
    "two_views",
]
