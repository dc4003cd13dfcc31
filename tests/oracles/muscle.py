"""The McKibben muscle of [T] in braid-angle form, and its corrections, in plain floats.

Written from the equations of Tondu and Lopez (2000) with the braid angle α as the variable, where the
package uses the contraction ratio; angles in rad, SI, P gauge. Shared by the oracles of the three rigs.
"""

from math import cos, exp, pi, sin, sqrt

BAR = 1e5
THRESHOLDS = [0.01 * i for i in range(1, 9)]


def schulte_force(card, strain, gauge, end_factor):
    """[T] 6: F = (π D90²/4) P (3 cos²α - 1), D90 the braid's diameter at an angle of 90°."""
    cosine = cos(card["braid_angle"]) * (1 - end_factor * strain)
    diameter = 2 * card["initial_radius"] / sin(card["braid_angle"])
    return pi * diameter**2 / 4 * gauge * (3 * cosine**2 - 1)


def cylinder(card, contraction, wall=0.0):
    """[T] 3: volume of the plain cylinder within a `wall` [m], and its slope over the contraction."""
    length = card["initial_length"] - contraction
    cosine = cos(card["braid_angle"]) * length / card["initial_length"]
    widest = card["initial_radius"] / sin(card["braid_angle"])
    area = pi * widest**2
    volume, slope = area * length * (1 - cosine**2), -area * (1 - 3 * cosine**2)
    if wall:
        volume -= pi * wall * (2 * widest * sqrt(1 - cosine**2) - wall) * length
        slope += wall_area(widest, wall, cosine)
    return volume, slope


def wall_area(widest, wall, cosine):
    """Force over pressure that a wall adds, Chou and Hannaford 1996: π (D90 t (2 sin α - 1 / sin α) - t²).

    It is -dV/dl of what the wall takes from the volume π (r - t)² l, the braid outside on radius r.
    """
    sine = sqrt(1 - cosine**2)
    return pi * wall * (2 * widest * (2 * sine - 1 / sine) - wall)


def contact(card, strain):
    """[T] 14: thread-on-thread surface S."""
    shortened = 1 - card["end_factor"] * strain
    sine = sqrt(1 - (cos(card["braid_angle"]) * shortened) ** 2)
    scale = 2 * pi * card["initial_radius"] * card["initial_length"] * sin(card["braid_angle"])
    return scale / (shortened * sine)


def corrected_force(card, effects, strain, gauge, plays):
    """Static force with the declared ones of: ends, bladder, its stretch and thickness, hysteresis."""
    k = card["end_factor"]
    force = schulte_force(card, strain, gauge, k)
    if ends := effects.get("pressure_dependent_ends"):
        force = schulte_force(card, strain, gauge, k + ends["amplitude"] * exp(-gauge / BAR))
    if bladder := effects.get("bladder_stiffness"):
        # What the braid feels is max(P - P_b, 0), of a pressure that is not below ambient.
        felt = max(gauge - bladder["threshold_pressure"], 0.0) if gauge > 0 else gauge
        force -= schulte_force(card, strain, gauge - felt, k)
        force -= bladder["stiffness"] * strain
    if wall := effects.get("bladder_hoop_stiffness"):
        cosine = cos(card["braid_angle"]) * (1 - k * strain)
        q = sqrt(1 - cosine**2) / sin(card["braid_angle"])
        slope = cosine * cos(card["braid_angle"]) / (sin(card["braid_angle"]) ** 2 * q)
        force -= wall["wall_stiffness"] * slope * (q - 1)
    if wall := effects.get("wall_thickness"):
        cosine = cos(card["braid_angle"]) * (1 - k * strain)
        widest = card["initial_radius"] / sin(card["braid_angle"])
        force += gauge * wall_area(widest, wall["thickness"], cosine)
    if loop := effects.get("length_hysteresis"):
        force -= hysteresis(card, loop, strain, gauge, plays)
    return force


def aged(effects, force, delayed, time):
    """A force less creep (strains delayed by a fast and a slow time), of which a share is lost over time."""
    if creep := effects.get("creep"):
        force = force - creep["stiffness"] * sum(delayed) / 2
    if drift := effects.get("force_drift"):
        force = force * (1 - drift["share"] * (1 - exp(-time / drift["time_constant"])))
    return force


def creeping(effects, strain, delayed):
    """Rates of the two delayed strains of creep (1/s)."""
    creep = effects.get("creep")
    if creep is None:
        return [0.0] * len(delayed)
    times = creep["fast_time"], creep["slow_time"]
    return [(strain - late) / time for late, time in zip(delayed, times, strict=True)]


def hysteresis(card, loop, strain, gauge, plays):
    """Force w π r0² P h (1 + s h) of the loop; h: mean of the stops ε - F_r under exp(-r/ρ), -1 to 1."""
    weights = [exp(-r / loop["density_width"]) for r in THRESHOLDS]
    stops = [strain - z for z in moved(plays, strain)]
    full = sum(w * r for w, r in zip(weights, THRESHOLDS, strict=True))
    h = sum(w * s for w, s in zip(weights, stops, strict=True)) / full
    return loop["weight"] * pi * card["initial_radius"] ** 2 * gauge * h * (1 + loop["asymmetry"] * h)


def moved(plays, value):
    """[W] play operators after the input has gone straight to `value`."""
    return [max(value - r, min(value + r, z)) for r, z in zip(THRESHOLDS, plays, strict=True)]


def thread_limit(card, effects, strain, gauge, velocity):
    """[T] 15, 16: f S P, f from static to kinetic over the velocity."""
    if "thread_friction" not in effects:
        return 0.0
    return thread_coefficient(effects, velocity) * contact(card, strain) * max(gauge, 0.0)


def thread_coefficient(effects, velocity):
    """[T] 16: from static to kinetic over the velocity; 0 without thread friction."""
    friction = effects.get("thread_friction")
    if friction is None:
        return 0.0
    fs, fk = friction["static_coefficient"], friction["kinetic_coefficient"]
    return fk + (fs - fk) * exp(-abs(velocity) / friction["velocity_constant"])
