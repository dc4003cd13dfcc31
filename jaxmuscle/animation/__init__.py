"""Pictures of a machine: valve, bladder and braid, load or joint, still (`draw`) and moving (`animate`)."""

# Each of these modules registers its scenes when it is imported.
from jaxmuscle.animation import jet_pipe_scene, joint_scenes, muscle_scenes
from jaxmuscle.animation.animate import Animation, animate, draw
from jaxmuscle.animation.scenes import Scene, scene

__all__ = [
    "Animation",
    "Scene",
    "animate",
    "draw",
    "jet_pipe_scene",
    "joint_scenes",
    "muscle_scenes",
    "scene",
]
