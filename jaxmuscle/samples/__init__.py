"""Short recordings that come with the package, one for each rig: `lift`, `bench` and `swing`."""

from importlib.resources import files
from pathlib import Path

from jaxmuscle.errors import InputError, nearest

NAMES = ("lift", "bench", "swing")


def sample(name: str) -> Path:
    """The table of a sample recording; its card lies beside it.

    Raises:
        InputError: there is no sample of that name.
    """
    if name not in NAMES:
        raise InputError(f"no sample recording {name!r}{nearest(name, NAMES)}")
    return Path(str(files(__name__).joinpath(f"{name}.csv")))
