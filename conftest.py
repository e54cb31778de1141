"""For all tests, of the core and of every plugin: how many examples, and where verdicts are kept.

Property tests draw the same examples in every run. ``make test`` takes the profile `fast`, ``make
test-all`` takes `whole`, by ``--hypothesis-profile=whole``, and ``make test-release`` `thorough`.
A test that asks for a number of its own asks for ``examples(number)`` of ``tests/support``.
"""

import gc
import os
import signal
import threading

import pytest
from hypothesis import HealthCheck, settings

repeatable = settings(
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile("fast", repeatable, max_examples=10)
settings.register_profile("whole", repeatable, max_examples=40)
settings.register_profile("thorough", repeatable, max_examples=100)
settings.load_profile("fast")

# Several processes test at the same time: threads of each would only wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")


# All that is collected stays: looking for garbage among it only takes time.
gc.disable()


# The machine loses no power during a test: to wait for the disk would only take time.
os.fsync = os.fstat


# A shell that runs the suite in the background has all of it ignore Ctrl-C, and nohup the end of
# the terminal; the programs that tests start would ignore them, too.
if threading.current_thread() is threading.main_thread():
    for number in (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)


def pytest_collection_finish(session):
    """Thousands of tests are alive from here on: no garbage collection need look at them again."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(100_000, 20, 20)


@pytest.fixture(scope="session", autouse=True)
def _cache_folder(tmp_path_factory):
    """No test touches the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield
