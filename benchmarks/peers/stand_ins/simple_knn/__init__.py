"""Stand-in for simple-knn, a CUDA extension that the original trainer of 3DGS imports."""
