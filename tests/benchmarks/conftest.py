"""The GPU script needs Python 3.11."""

import sys

collect_ignore = [] if sys.version_info >= (3, 11) else ["test_gpu.py", "test_gpu_kernels.py"]
