"""Scenes that come with msdwarp, as tests play them."""

import importlib

import msdwarp as msd


def build(name, **parameters):
    return importlib.import_module(f"msdwarp.scenes.{name}").build(**parameters)


def simulate(scene, duration, **options):
    return list(msd.Simulation.from_scene(scene, **{"device": "cpu", **options}).frames(duration))
