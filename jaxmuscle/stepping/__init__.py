"""From one sample to the next, by a choice of methods, in fixed or controlled steps.

Whatever the method, unilateral contacts act and play operators are brought up to date at the end of each
step, without error of their own. The command is held between samples, so each sample is a fresh start.
"""

from jaxmuscle.stepping.advance import advance
from jaxmuscle.stepping.controlled import FASTEST, LEAST, SAFETY, SLOWEST, SMALLEST, Course, begin_course
from jaxmuscle.stepping.methods import CONTROLLED, METHODS, method_for, step
from jaxmuscle.stepping.plan import Field, Finish, Plan

__all__ = [
    "CONTROLLED",
    "FASTEST",
    "LEAST",
    "METHODS",
    "SAFETY",
    "SLOWEST",
    "SMALLEST",
    "Course",
    "Field",
    "Finish",
    "Plan",
    "advance",
    "begin_course",
    "method_for",
    "step",
]
