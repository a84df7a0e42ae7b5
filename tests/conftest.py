"""Fixtures of more than one module."""

import gc
import math
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser
    from xdist.remote import Producer
    from xdist.scheduler import WorkStealingScheduling


def pytest_configure() -> None:
    """Tests, and programs that they start, heed Ctrl-C, also where a shell started them in the background.

    No example of a property has a deadline: how long one takes says how busy the machine is.
    """
    from hypothesis import settings

    signal.signal(signal.SIGINT, signal.default_int_handler)
    settings.register_profile("without deadline", deadline=None)
    settings.load_profile("without deadline")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """What is there when the tests begin stays: no search for garbage goes through it while it grows, or later.

    Linear algebra takes one thread, so that no second one waits for a core that another worker has.
    """
    from threadpoolctl import threadpool_limits

    gc.disable()
    yield
    gc.collect()
    gc.freeze()
    gc.enable()
    threadpool_limits(1, user_api="blas")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: "Producer") -> "WorkStealingScheduling":
    """Tests in a row stay with one worker, so that what a module's tests share is made once."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log)


@pytest.fixture(autouse=True)
def _quiet_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    """No lines of progress, however slow the machine: tests hold what a command says against what it should."""
    monkeypatch.setattr("designer.page.progress.SAID_EVERY_S", math.inf)


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    """Chromium, started once for a module's tests, as its event loop is in the way of others; skipped without one."""
    from tests.support.browser import started_browser

    with started_browser() as started:
        yield started


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the commands take; not to be changed."""
    from tests.support.command_scene import make_scene

    folder = tmp_path_factory.mktemp("scene")
    make_scene(folder)
    return folder


@pytest.fixture
def scene_copy(scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it to work in, whose photos a detector knows without looking."""
    from tests.support.command_scene import without_waiting

    shutil.copytree(scene, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    without_waiting(monkeypatch)
    return tmp_path
