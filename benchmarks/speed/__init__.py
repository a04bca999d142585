"""How fast msdwarp is: a substep, a large body, a run whose frames are kept, every scene for half a minute."""
