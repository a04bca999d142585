"""Passes: the depth and the bodies of pictures, as files for compositing."""

import colorsys
import json
from pathlib import Path

import numpy as np
from PIL import Image

from ...disk import writing
from ...pictures import ColorScale, Drawing, Passes, Stage
from ...world import Scene
from ..picture_options import Pictures
from ..results import MASKS, pass_path
from .drawn import bodies_of
from .moments import Moment

MOST = 255
"""Largest number of a body in a mask, whose pixels are bytes."""


class PassFiles:
    """Writes the passes of pictures into a folder."""

    def __init__(
        self, scene: Scene, coloring: str | ColorScale, stage: Stage, pictures: Pictures, folder: Path
    ) -> None:
        self._drawing = Drawing(scene, coloring, bodies=pictures.body)
        self._passes, self._stage = Passes(self._drawing, stage), stage
        self._kinds, self._folder = pictures.passes, folder
        parts = [*self._drawing.body, *self._drawing.obstacles]
        names, self._number = list[str](), np.zeros(len(self._drawing.triangles) + 1, np.int64)  # the last: for -1
        starts = dict(zip(map(id, parts), np.cumsum([0, *(len(part.triangles) for part in parts)]), strict=False))
        for one in bodies_of(self._drawing, parts, scene):
            if one.mesh.name not in names:
                names.append(one.mesh.name)
            mine = np.arange(len(one.part.triangles))[one.triangles]
            self._number[starts[id(one.part)] + mine] = len(names)
        if "mask" in self._kinds:
            if len(names) > MOST:
                raise ValueError(
                    f"passes has 'mask' for {len(names)} bodies; it must be at most {MOST}: name some by body"
                )
            with writing(folder / MASKS) as unfinished:
                unfinished.write_text(json.dumps(dict(enumerate(names, start=1)), indent=1))

    def write(self, k: int, moment: Moment) -> None:
        """Write the passes of the film's picture k, which shows a moment."""
        position, time, values, _ = moment
        self._drawing.follow(position, time, values)
        depth, triangle = self._passes.draw(self._stage.camera_at(time, position))
        for kind in self._kinds:
            with writing(pass_path(self._folder, kind, k)) as unfinished:
                if kind == "depth":
                    Image.fromarray(depth).save(unfinished, "TIFF", compression="tiff_adobe_deflate")
                else:
                    mask = Image.fromarray(self._number[triangle].astype(np.uint8), "P")
                    mask.putpalette(_palette())
                    mask.save(unfinished, "PNG")


def _palette() -> list[int]:
    """Return colors of the numbers 0 … 255, as bytes: black for none, and unlike ones for neighbours."""
    shades = [colorsys.hsv_to_rgb(k * 0.618034 % 1, 0.65, 0.95) for k in range(MOST)]
    return [0, 0, 0, *(round(255 * channel) for shade in shades for channel in shade)]
