"""Does contact obey the laws of textbook mechanics? Sliding, rolling, a rope around a bollard, Hertz, a stack.

    python -m benchmarks.accuracy.contact_mechanics [--device D] [--quick] [--plot-only] [--only sliding stack]

Five questions, each a CSV, all at automatic substeps in float32:

- contact_sliding.csv: a die slides on a pinned slab. Its acceleration, from a line through its speeds, gives the
  friction that acts, (g sin α − a)/(g cos α): is it the friction asked for? Where Coulomb's law says that the die
  sticks, how fast does it creep? Gravity leans, not the bodies.
- contact_rolling.csv: a ball rolls down a plane or a pinned slab, at g sin α / (1 + I/(m r²))? I is that of its
  particles, r the radius that is drawn.
- contact_capstan.csv: a rope lies half around a bollard. One end is pulled more and more. At which ratio of the
  ends' tensions does the other end begin to move, and which does the rope have while it slides: exp(μ π)?
- contact_hertz.csv: a ball is pressed on a plane or a pinned slab. Is the force 4/3 E* √R d^1.5?
- contact_stack.csv: three dice lie on each other. Do contact forces carry the weights above?
"""

import argparse
import sys
import time

from ..common import arguments, machine, read_csv, table, write_csv
from .contact_blocks import measure_sliding, measure_stack
from .contact_mechanics_plots import draw_rolling, draw_sliding
from .contact_round import measure_capstan, measure_hertz, measure_rolling

PARTS = {
    "sliding": (measure_sliding, draw_sliding),
    "rolling": (measure_rolling, draw_rolling),
    "capstan": (measure_capstan, None),
    "hertz": (measure_hertz, None),
    "stack": (measure_stack, None),
}


def main() -> None:
    """Measure, write, print and draw."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS), help="these parts only")
    options = arguments(__doc__.splitlines()[0], own)
    for part in options.only:
        measure, draw = PARTS[part]
        path = options.folder / f"contact_{part}.csv"
        if not options.plot_only:
            begun = time.perf_counter()
            write_csv(path, measure(options), machine(options.device))
            print(f"{path.name}: {time.perf_counter() - begun:.0f} s", flush=True)
        _, rows = read_csv(path)
        table(path.name, list(rows[0]), [list(row.values()) for row in rows])
        if draw is not None and not options.quick:
            draw(rows)


if __name__ == "__main__":
    sys.exit(main())
