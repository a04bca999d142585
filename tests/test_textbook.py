"""Four of the textbook experiments of docs/validation.md, smaller."""

import importlib
from pathlib import Path

import pytest


@pytest.fixture
def textbook(monkeypatch):
    pytest.importorskip("scipy")
    monkeypatch.syspath_prepend(Path(__file__).parents[1])
    return importlib.import_module("benchmarks.accuracy.validation").EXPERIMENTS


def test_the_lower_end_of_a_slinky_waits_for_the_wave(textbook):
    top, arrives = textbook["slinky drop"]("cpu", count=60).quantities
    # The front of a wave in N springs is as wide as N^(1/3) springs; straight lines are fitted clear of it.
    assert top.deviation == pytest.approx(0, abs=1e-4)
    assert arrives.deviation == pytest.approx(0, abs=5e-3)


def test_a_rope_hangs_as_an_elastic_catenary(textbook):
    for one in textbook["catenary"]("cpu", count=40).quantities:
        assert one.deviation == pytest.approx(0, abs=1 / 40**2)  # second order in the spacing


def test_an_elastic_pendulum_swings_as_its_equations_say(textbook):
    (place,) = textbook["elastic pendulum"]("cpu").quantities
    assert place.measured == pytest.approx(place.exact, abs=1e-9)  # RK4 with (h ω)⁴ of 4e-7 a second at most


def test_a_stiff_body_flips_about_its_middle_axis(textbook):
    (flip,) = textbook["Dzhanibekov"]("cpu").quantities
    # Its arms stretch by m ω² l/k, 4e-5 of their length; flips are interpolated between frames of 5 ms.
    assert flip.deviation == pytest.approx(0, abs=1e-4)
