"""Contact between bodies: points on their surfaces against facets, found with neighbor lists.

In the order of a substep: `vertices` places the surfaces and decides whether lists are still valid. If not,
`facet_tree` makes boxes and finds which bodies are near each other (the broad phase); `pair_search` lists near
pairs, and `neighbor_search` the facets near each point (the narrow phase). `body_contact` exerts forces by `law`
and `force_sums`; `segments_and_spheres` does so among ropes and grains alone, `surface_contact` against obstacles.
At the end `pair_gaps` tells whether pairs come too near, and `division_planes` keeps them apart.
"""
