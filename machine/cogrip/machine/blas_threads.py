"""Numbers of threads for the linear algebra behind numpy: these, set before numpy is imported."""

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
SAFE_PATH = "PYTHONSAFEPATH"  # a Python process that finds it set imports nothing from the folder it is started in
