"""Common to all tests."""

import pytest
import torch


@pytest.fixture(autouse=True, scope="session")
def _one_thread_per_process() -> None:
    """pytest-xdist runs a process per core; more torch threads than that slow all of them down."""
    torch.set_num_threads(1)
