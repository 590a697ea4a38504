"""The CPU rasterizer: native code with SIMD, the default where there is no GPU."""
