"""Substeps of a frame that are recorded once and repeated by the device."""

from collections.abc import Callable

import warp as wp

from ...kernels.threads import count_down

DIFFERENT = 2
"""The first substeps of a frame differ from the others; so does the last one."""
ON_CPU, ON_GPU = 2, 16
"""How many substeps are repeated: recording each takes 1 ms, and a GPU's repetition 10 µs.

After an even number the state is again in the arrays where it began. A GPU's number is a multiple of the substeps
between two decisions whether to search for contact.
"""


def repetitions(substeps: int, repeated: int) -> int:
    """Return how often the device repeats `repeated` substeps of a frame; 0 if not more than once."""
    times = (substeps - DIFFERENT - 1) // repeated if repeated else 0
    return times if times > 1 else 0


def repeat(left: wp.array, times: int, launch: Callable[[], object]) -> None:
    """Record launches that run `times` times, at least once; `left`, shape [1], counts down."""

    def launch_once() -> None:
        launch()
        wp.launch(count_down, 1, [left], device=left.device)

    left.fill_(times)
    wp.capture_while(left, launch_once)
