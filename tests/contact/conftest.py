"""Fixtures of the contact tests."""

import numpy as np
import pytest


@pytest.fixture
def rng() -> np.random.Generator:
    """Return numbers that are the same in each run."""
    return np.random.default_rng(20240607)
