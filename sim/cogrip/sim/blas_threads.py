"""How many threads the linear algebra behind numpy may have: these, set before numpy is imported."""

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
