"""Pictures of a machine: valve, bladder and braid, load or joint, still (`draw`) and moving (`animate`)."""

from jaxmuscle.animation.animate import Animation, animate, draw
from jaxmuscle.animation.scenes import Scene, scene

__all__ = ["Animation", "Scene", "animate", "draw", "scene"]
