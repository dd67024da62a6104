"""Who does the work items: this process, worker processes, or a Ray cluster."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from importlib import import_module
from itertools import islice
from typing import Any, Protocol

from lasergym.comparison.work import Row, WorkItem, run_item
from lasergym.errors import LasergymError, MissingExtraError

__all__ = ["FarmError", "run_local", "run_on_ray"]

_IN_FLIGHT = 2
"""Items handed out per worker, so that none waits for its next one."""


class FarmError(LasergymError, RuntimeError):
    """Workers cannot be reached or have died."""


class _StopFlag(Protocol):
    """What workers ask whether to give up."""

    def is_set(self) -> bool: ...


def run_local(items: Sequence[WorkItem], jobs: int) -> Iterator[Row]:
    """Does items on this machine; the results come in any order.

    Args:
        items: The items.
        jobs: Worker processes; with 1 this process does the work.

    Raises:
        FarmError: A worker process has died.
        KeyboardInterrupt: The work was interrupted; whatever was under way is given up.
    """
    if jobs == 1 or len(items) == 1:
        for item in items:
            yield _finished(run_item(item))
        return
    # Fresh processes: a forked one would inherit the threads' locks without the threads.
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    pool = ProcessPoolExecutor(
        min(jobs, len(items)), mp_context=context, initializer=_enter_worker, initargs=(stop,)
    )
    try:
        waiting = iter(items)
        running: set[Future[Row | None]] = set()
        while True:
            with _interrupts_later():
                for item in islice(waiting, _IN_FLIGHT * jobs - len(running)):
                    running.add(pool.submit(_run_in_worker, item))
            if not running:
                return
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield _finished(future.result())
    except BrokenProcessPool as error:
        raise FarmError(
            "a worker process has died (out of memory?): the same command goes on; "
            "fewer --jobs take less memory"
        ) from error
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def run_on_ray(items: Sequence[WorkItem], address: str, jobs: int | None = None) -> Iterator[Row]:
    """Does items on a Ray cluster; the results come in any order.

    lasergym of the same version must be installed on every node.

    Args:
        items: The items.
        address: ``"local"`` starts an instance on this machine, ``"auto"`` joins the one that
            runs, all else is the address of a cluster.
        jobs: Processors of a local instance; None takes all.

    Raises:
        MissingExtraError: Ray is not installed.
        FarmError: The cluster cannot be reached, or a worker has died.
    """
    ray = _import_ray()
    joined = ray.is_initialized()
    if not joined:
        _start_ray(ray, address, jobs)
    running: list[Any] = []
    try:
        slots = max(1, int(ray.cluster_resources().get("CPU", 1)))
        remote = ray.remote(num_cpus=1)(_run_on_node)
        waiting = iter(items)
        while True:
            room = _IN_FLIGHT * slots - len(running)
            running.extend(remote.remote(item) for item in islice(waiting, room))
            if not running:
                return
            done, running = ray.wait(running, num_returns=1)
            for reference in done:
                yield _finished(ray.get(reference))
    except ray.exceptions.RayTaskError as error:
        if isinstance(error.cause, LasergymError):
            raise error.cause from None
        raise FarmError(f"an item failed on the Ray cluster: {error.cause!r}") from error
    except ray.exceptions.RayError as error:
        raise FarmError(f"the Ray cluster lost an item: {error}") from error
    finally:
        for reference in running:
            ray.cancel(reference, force=True)
        if not joined:
            ray.shutdown()


def _finished(row: Row | None) -> Row:
    """The result of an item; a planner that was interrupted has none."""
    if row is None:
        raise KeyboardInterrupt
    return row


@contextmanager
def _interrupts_later() -> Iterator[None]:
    """Holds Ctrl-C back; processes that start meanwhile never see it, which Windows cannot do."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_never_stop = threading.Event()
_worker_stop: _StopFlag = _never_stop


def _enter_worker(stop: _StopFlag) -> None:
    """Leaves Ctrl-C to the main process, which sets ``stop``, and ends when that process dies."""
    global _worker_stop
    _worker_stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run_in_worker(item: WorkItem) -> Row | None:
    return run_item(item, _worker_stop.is_set)


def _run_on_node(item: WorkItem) -> Row | None:
    """Imports by full name, since a fresh node has imported nothing."""
    import lasergym.comparison.work

    return lasergym.comparison.work.run_item(item)


def _import_ray() -> Any:
    try:
        return import_module("ray")
    except ImportError as error:
        raise MissingExtraError("a Ray cluster needs Ray: pip install 'lasergym[ray]'") from error


def _start_ray(ray: Any, address: str, jobs: int | None) -> None:
    local = address == "local"
    settings: dict[str, Any] = {"num_cpus": jobs, "include_dashboard": False} if local else {}
    try:
        ray.init(address=address, log_to_driver=False, logging_level="ERROR", **settings)
    except (ConnectionError, OSError, RuntimeError, ValueError) as error:
        raise FarmError(f"Ray cannot be reached at {address!r}: {error}") from error
