"""msdwarp beside other codes and hand-written CUDA, at equal steps and at equal error."""
