"""What a first fit compiles."""

import jax
from estimation.made import fitted, pulled


def test_making_a_recording_ready_compiles_next_to_nothing():
    """Each operation of JAX outside a program is a program of its own; a fit had 66 of them."""
    compiled = []
    listening = [True]

    def hear(event, duration_secs, **_):
        if listening[0] and event.endswith("backend_compile_duration"):
            compiled.append(duration_secs)

    jax.monitoring.register_event_duration_secs_listener(hear)
    try:
        # Of a length that no other test has, so that nothing is at hand.
        fitted(pulled(seconds=7.31, threads=True))
    finally:
        listening[0] = False
    assert 3 <= len(compiled) <= 14
