"""BodyContactWorlds: contact between the bodies of each world of an ensemble."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from ...kernels.collision import COUNT, FACET, FLAGS, MOVED, POINT
from .body_contact import OVERLAP, BodyContact
from .contact_parameters import stiffness_of_pairs
from .neighbor_list import FARTHEST_WAY
from .tunnelling import Tunnelling


class BodyContactWorlds(BodyContact):
    """Keeps the bodies of each world out of each other, in all worlds at once.

    Forces on a world's bodies are those of that world alone, to the last bit: they are summed as integers, and
    which facets are listed beside those touched changes nothing. A frame in which the lists of any world did not
    hold is repeated by all.

    Attributes
    ----------
    frozen
        Whether each world was frozen before the last frame: what its bodies do since does not count.
    """

    by_world = ("force",)

    def _sink(self) -> None:
        """Raise ValueError where bodies overlap at the start: what leads them apart is not of single worlds."""
        self._overlapping_at_start, self._overlapping = False, None
        model: Any = self._model
        data, surfaces = self._data, self._surfaces
        worlds, bodies, points = model.worlds, len(surfaces.closed), len(surfaces.share)
        self.frozen = np.zeros(worlds, dtype=bool)
        x = model.vectors()
        x.assign(model.spread(model.row_of("position").astype(model.dtype)))
        stored = self._stored_and_heated(x, model.vectors())[0].numpy()
        overlapping = np.flatnonzero(stored)
        if not len(overlapping):
            return
        a, b = data.body.numpy()[overlapping], data.candidate_body.numpy()[overlapping, 0]
        kind, stiffness = data.kind.numpy(), data.stiffness.numpy()
        rule = data.rule.numpy()[kind[a], kind[b]]
        k = stiffness_of_pairs(surfaces._replace(stiffness=stiffness), self._rules, rule, a, b)
        deep = np.sqrt(2 * stored[overlapping] / (k * data.density.numpy()[a]))
        spacing = np.maximum(surfaces.spacing[a % bodies], surfaces.spacing[b % bodies])
        excess = deep / np.maximum(spacing, self._farthest)
        p = int(np.argmax(excess))
        if excess[p] > OVERLAP:
            one, other = (int(np.argmax(surfaces.body_of_particle == body % bodies)) for body in (a[p], b[p]))
            raise ValueError(
                f"in world {overlapping[p] // points} the body of particle {one} starts {deep[p]:.3g} m inside "
                f"that of particle {other}; the bodies of each world of an ensemble must start apart"
            )

    def forget(self) -> None:
        """Forget what points stick to: all worlds start anew."""
        self._data.tangential_displacement.zero_()
        self._data.contact_body.fill_(-1)
        self._data.contact_side.zero_()
        self.frozen[:] = False

    def is_void(self) -> bool:
        """Tell whether lists held, in all worlds that count, in the frame that was waited for.

        Those that fly apart the watch sees.
        """
        flags = self._found.numpy().reshape(-1, FLAGS).copy()
        self._overrun = np.array(self._noted.numpy(), dtype=np.float64)
        if self._found is self._flags:
            self._flags.zero_()
            self._data.overrun.zero_()
        flags = flags[
            ~self.frozen & (flags[:, MOVED] < FARTHEST_WAY * self._farthest * self._neighbors.rebuild_interval)
        ]
        if not len(flags):
            return False
        void = self._neighbors.judge(flags.max(axis=0), self.steps.substeps)
        self.rebuild_interval = self._neighbors.rebuild_interval
        return void

    def warnings(self) -> str | None:
        """Return words about a contact that was overrun in the frame that was waited for, and in which world."""
        noted = self._overrun.copy()
        world, noted[POINT] = divmod(int(noted[POINT]), len(self._surfaces.share))
        noted[FACET] %= len(self._surfaces.corner)
        if not noted[COUNT] or self.frozen[world]:
            return None
        found = Tunnelling.of(noted, self._data, self._surfaces, self._rules)
        assert found is not None
        words = found.described(self._model.system, self._surfaces, self.steps.substeps, self._dt)
        return f"in world {world} {words}"

    def checkpoints(self) -> list[dict[str, NDArray]]:
        """Return of each world what `BodyContact.restore` takes: how its points stick."""
        points, bodies, arrays = len(self._surfaces.share), len(self._surfaces.closed), self.checkpoint()
        facets = len(self._surfaces.corner)
        found = []
        for world in range(self._model.worlds):
            own = {name: values[:, world * points : (world + 1) * points] for name, values in arrays.items()}
            contact_body = own["touch.partner"]
            own["touch.partner"] = np.where(contact_body >= 0, contact_body - world * bodies, contact_body)
            if "touch.seen" in own:
                seen = own["touch.seen"]
                own["touch.seen"] = seen - np.sign(seen) * (world * facets)
            found.append(own)
        return found

    @property
    def units(self) -> wp.array:
        """The unit in which the forces of each world are summed [N], shape [worlds]."""
        return self._data.unit

    def blocks_of(self, worlds: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what contacts add to the blocks of K [N/m] and B [N s/m] in so many worlds.

        They are of shape [worlds, particle_count], as `contact_blocks` says.
        """
        stiffness, damping = self.blocks
        each = np.arange(worlds) % len(stiffness)
        return stiffness[each], damping[each]
