"""Linear algebra on one thread, that of SciPy, too."""

from tests.support.programs import PYTHON, run

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")
FIRST_CALL = """
import sys
from threadpoolctl import threadpool_info
from calib.core.parallel import one_thread, one_thread_with_scipy

counted = lambda: {one["filepath"]: one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}

@one_thread
def before():
    return one_thread_with_scipy(counted)()

assert "scipy.linalg" not in sys.modules
threads = before()
assert len(threads) == len(counted()) and set(threads.values()) == {1}, threads
"""


def test_scipys_library_is_limited_from_the_first_call_on() -> None:
    """Whatever was limited before SciPy was there: in what uses it each library of linear algebra has one thread."""
    run(PYTHON, "-c", FIRST_CALL, **dict.fromkeys(THREADS, "2"))
