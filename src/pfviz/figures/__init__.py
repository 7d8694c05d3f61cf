"""Figures for slides and papers, drawn from the records of a run: Figures 1 to 3 of the sources, and plots over time.

Every function takes records and returns a matplotlib figure; ``render`` turns it into the bytes of a PNG, SVG or PDF
file. Nothing is computed again: what is drawn is what was recorded. Colours mean the same as in the app, and strength
(of a colour and of a size) means weight, so that a figure can be read in grey.

No pyplot, no global state: figures can be made in any thread. matplotlib is imported when the first one is.
"""

from pfviz.figures.course import PANELS, Course, course_of, plot_courses
from pfviz.figures.frame import plot_frame
from pfviz.figures.line import plot_line
from pfviz.figures.plane import plot_plane
from pfviz.figures.step import plot_step
from pfviz.figures.style import FORMATS, render

__all__ = [
    "FORMATS",
    "PANELS",
    "Course",
    "course_of",
    "plot_courses",
    "plot_frame",
    "plot_line",
    "plot_plane",
    "plot_step",
    "render",
]
