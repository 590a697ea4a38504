"""CUDA kernels: compiled by NVRTC where they are used, launched on torch's stream."""
