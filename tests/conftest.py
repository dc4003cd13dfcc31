"""What all tests share."""

from pathlib import Path

import pytest


@pytest.fixture
def shared() -> Path:
    """The folder beside the repository with recordings that are not part of it."""
    folder = Path(__file__).parents[2] / "shared"
    if not folder.is_dir():
        pytest.skip(f"there is no {folder}: its recordings do not come with the repository")
    return folder
