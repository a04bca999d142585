

@pytest.mark.parametrize("substeps", ["auto", 60])
def test_what_is_led_out_without_gravity_is_no_divergence(substeps):
    # Where nothing else moves, the energy of being led out is all there is.
    body = box((3, 3, 3), 0.1, mass=0.01, stiffness=200.0, damping=1.0).translate((0, 0, -0.15))
    with pytest.warns(DoubtfulStart):
        simulation = Simulation(body, colliders=[Plane()], gravity=0.0, substeps=substeps, device="cpu")
    simulation.step(60)
    assert simulation.frame().position[:, 2].min() > 0
