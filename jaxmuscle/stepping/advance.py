"""From one sample to the next, in fixed or controlled steps."""

from __future__ import annotations

from typing import Any

from jaxmuscle.stepping.controlled import Course, in_controlled_steps
from jaxmuscle.stepping.fixed import in_fixed_steps
from jaxmuscle.stepping.plan import Field, Finish, Plan


def advance(
    plan: Plan, field: Field, finish: Finish, state: Any, memory: Any, course: Course | None
) -> tuple[Any, Any, Course | None]:
    """State, memories and step control at the next sample; without states only memories change."""
    if course is None or not state:
        return *in_fixed_steps(plan, field, finish, state, memory), course
    return in_controlled_steps(plan, field, finish, state, memory, course)
