"""Requirements of a run: the floats of its model by purpose, and the PSNR that each part gains."""
