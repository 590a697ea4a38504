"""The interface of simple-knn, a CUDA extension that trainers of 3DGS import."""
