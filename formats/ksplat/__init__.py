"""KSPLAT (mkkellogg's GaussianSplats3D, version 0.1): sections of splats in three levels.

Level 0 is float32; level 1 has 16-bit positions relative to buckets of nearby splats and float16;
level 2 also has SH coefficients in bytes. The frame is that of a PLY.
"""
