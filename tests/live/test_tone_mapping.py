"""Colors of a page: what three.js makes of the paint that it is given."""

import numpy as np

from msdwarp.live.tone_mapping import paint

IN = [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
OUT = [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]


def shown(colors):
    """Return the bytes that a page shows of materials in full light: `ACESFilmicToneMapping` of three.js."""
    materials = np.asarray(colors) / 255
    linear = np.where(materials < 0.04045, materials / 12.92, ((materials + 0.055) / 1.055) ** 2.4)
    x = (linear / 0.6) @ np.transpose(IN)
    x = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081)
    x = np.clip(x @ np.transpose(OUT), 0, 1)
    return 255 * np.where(x < 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def test_a_page_shows_colors_in_full_light_as_given():
    levels = np.arange(16, 208, 16)
    colors = np.stack(np.meshgrid(levels, levels, levels), axis=-1).reshape(-1, 3)
    within = (colors.max(axis=1) - colors.min(axis=1)) < 96  # the curve has no brighter saturated colors
    away = np.abs(shown(paint(colors[within])) - colors[within])
    assert away.max() < 6  # of 255: the steps of paint, where the curve is steep in the dark
    assert away.mean() < 1


def test_what_is_too_bright_for_a_page_is_darker_in_the_same_hue():
    color = np.array([246, 241, 231])
    found = shown(paint(color))
    assert 210 < found.max() < 240
    linear = (found / color) ** 2.2
    np.testing.assert_allclose(linear / linear.mean(), 1, atol=0.02)  # steps of a byte
