"""What is observed of an ensemble is what its frames say."""

import sys

import numpy as np
import pytest
import warp as wp
from alone import simulation_alone

from msdwarp import Actuator, Ensemble, GroupMean, Leapfrog, Plane, Probe, box

xarray = pytest.importorskip("xarray")
WORLDS = 4


@wp.func
def speed_squared(x: wp.vec3d, v: wp.vec3d, i: int) -> wp.float64:
    return wp.dot(v, v)


@wp.func
def place(x: wp.vec3d, v: wp.vec3d, i: int) -> wp.vec3d:
    return x


def ensemble(device: str, **options) -> Ensemble:
    body = box((3, 3, 3), 0.1, stiffness=1e3, damping=1.0).translate((0.0, 0.0, 0.15))
    body = body.replace(groups={"top": range(18, 27)})
    given = {
        "stiffness": np.linspace(500, 2000, WORLDS),
        "gravity": [5.0, 9.0],
        "mass": [1.0, 2.0],
        "friction": [0.2],
    }
    how = {"colliders": [Plane()], "device": device, "force_algorithm": "gather", "integrator": Leapfrog()}
    return Ensemble(body, WORLDS, **(given | how | options))


@pytest.mark.slow
def test_sums_are_those_of_the_frames(plain_device):
    observed = ensemble(plain_device, precision="float32-compensated").run(
        0.2,
        observe={
            "top": Probe("top", "position"),
            "drift": Probe("top", "velocity"),
            "squared": GroupMean(speed_squared, on="top"),
            "centre": GroupMean(place, width=3),
            "x": "positions",
            "v": "velocities",
            "energy": "energy",
            "parts": lambda position, velocity: position.mean(axis=1)[:, 2],
        },
        every=4,
    )
    assert observed.sizes == {"world": WORLDS, "frame": 4, "axis": 3, "particle": 27, "centre_0": 3}
    np.testing.assert_allclose(observed.time, np.arange(4) * 4 / 60, rtol=1e-15)
    x, v = observed.x.values.astype(float), observed.v.values.astype(float)
    # Sums of at most 27 numbers in float64, in another order: rounding is some 1e-16 of them.
    near = {"rtol": 1e-12, "atol": 1e-13}
    np.testing.assert_allclose(observed.top, x[:, :, 18:].mean(axis=2), **near)
    np.testing.assert_allclose(observed.drift, v[:, :, 18:].mean(axis=2), **near)
    np.testing.assert_allclose(observed.squared, (v[:, :, 18:] ** 2).sum(axis=-1).mean(axis=2), **near)
    np.testing.assert_allclose(observed.centre, x.mean(axis=2), **near)
    # The function is given numbers of the precision, whose own mean is rounded.
    np.testing.assert_allclose(observed.parts, x.mean(axis=2)[..., 2], rtol=1e-6)
    assert observed.top.attrs["units"] == "m"
    np.testing.assert_array_equal(observed.gravity, [5.0, 9.0, 5.0, 9.0])
    np.testing.assert_array_equal(observed.stiffness, np.linspace(500, 2000, WORLDS))
    assert (observed.status == "running").all()
    assert observed.attrs["integrator"] == "Leapfrog(damper_extrapolation=0.0)"


@pytest.mark.slow
def test_energies_are_those_of_simulations(plain_device):
    worlds = ensemble(plain_device, precision="float64")
    names = ("kinetic energy", "elastic energy", "gravitational energy")
    observed = worlds.run(0.3, observe={name.split()[0]: name for name in names} | {"all": "energy"}, every=9)
    for world in range(WORLDS):
        alone = worlds.simulation_of(world)
        for frame in range(3):
            measured = alone.measure()
            # On a GPU forces are summed in another order, and so states of some joules differ by rounding.
            for name in names:
                value = getattr(measured, name.replace(" ", "_"))
                assert observed[name.split()[0]].values[world, frame] == pytest.approx(value, rel=1e-12, abs=1e-12)
            assert observed["all"].values[world, frame] == pytest.approx(measured.energy, rel=1e-12, abs=1e-12)
            if frame < 2:
                alone.step(9)


@pytest.mark.slow
def test_probes_measure_in_each_world_what_they_do_alone(plain_device):
    quantities = ("position", "velocity", "force", "strain", "tension")
    probes = {name: Probe("top", name) for name in quantities}
    muscles = {"loads": [Actuator(0.0)], "strain": lambda t: np.array([0.1, 0.2]) * np.sin(20 * t)}
    worlds = ensemble(plain_device, precision="float32-compensated", damping=[0.5, 1.5], substeps=20, **muscles)
    observed = worlds.run(0.2, observe=probes, every=12)
    for world in range(WORLDS):
        alone = simulation_alone(worlds, world, probes=probes)
        alone.step(12)
        for name in quantities:
            # The same numbers, summed in another order on a GPU.
            expected = alone.readings[name].values[-1]
            np.testing.assert_allclose(observed[name].values[world, -1], expected, rtol=1e-9, atol=1e-12)
    assert observed.strain.dims == ("world", "frame", "strain_0")


def test_what_all_do_by_default_and_in_a_file(tmp_path):
    pytest.importorskip("h5netcdf")
    observed = ensemble("cpu").run(0.1)
    assert set(observed.data_vars) == {"position", "velocity"}
    observed.to_netcdf(tmp_path / "worlds.nc", engine="h5netcdf")
    with xarray.open_dataset(tmp_path / "worlds.nc", engine="h5netcdf") as stored:
        xarray.testing.assert_identical(stored.load().position, observed.position)
        assert list(stored.status.values) == ["running"] * WORLDS
        np.testing.assert_array_equal(stored.time, observed.time)


@pytest.mark.parametrize(
    ("observe", "said"),
    [
        ({"a": Probe("top", "contact force")}, r"observe\['a'\]: what is 'contact force'"),
        ({"a": Probe("top", "position", every="substep")}, "every is 'substep'"),
        ({"a": Probe("bottom", "position")}, "bottom"),
        ({"a": "heat"}, "it is 'heat'"),
        ({"a": 3}, "it is 3"),
        ({3: "energy"}, "a name in observe is 3"),
        ({"a": lambda x, v: 1.0}, "the first axis must be that of the 4 worlds"),
    ],
)
def test_what_cannot_be_observed_is_said(observe, said):
    with pytest.raises(ValueError, match=said):
        ensemble("cpu").run(0.1, observe=observe)


def test_bad_arguments_of_a_run(monkeypatch):
    worlds = ensemble("cpu")
    with pytest.raises(ValueError, match="every is 7; it must be at most the 6 frames"):
        worlds.run(0.1, every=7)
    with pytest.raises(ValueError, match="function is <function"):
        GroupMean(lambda x, v, i: x)
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ValueError, match=r"need xarray: pip install 'msdwarp\[ensemble\]'"):
        worlds.run(0.1)
    assert worlds.frame_index == 0
