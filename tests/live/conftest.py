"""A view with a page, for all tests that open one."""

import pytest


@pytest.fixture
def view():
    """A view that runs in a thread of its own, and whose page clients may open."""
    pytest.importorskip("viser")
    from pages import served

    made = served()
    yield made
    made.close()
