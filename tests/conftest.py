"""Fixtures that every test may use."""

import pytest
import warp as wp

wp.config.log_level = wp.LOG_ERROR


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what needs a GPU where there is none."""
    if item.get_closest_marker("gpu") and not wp.is_cuda_available():
        pytest.skip("there is no CUDA device here")


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
def device(request: pytest.FixtureRequest) -> str:
    """Each device in turn."""
    return request.param
