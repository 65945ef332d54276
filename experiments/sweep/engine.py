"""Many runs in parallel, each once, here or on an engine that stands already.

A worker claims a run by a lock on a file, which the system gives back when the process ends,
however it ends; it writes the run's record beside its place and moves it there. So whoever is
killed, worker, scheduler or driver, no finished run is lost, and none is done again: the same sweep
into the same folder goes on with what has no record. Workers on other machines need that folder
under the same path.
"""

import ctypes
import fcntl
import json
import os
import signal
import socket
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, wait
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, Protocol, TypeVar

import cv2
import numba
from joblib.externals.loky import ProcessPoolExecutor
from threadpoolctl import threadpool_limits

from breastscan.errors import ConfigError

ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "LP_NUM_THREADS",
    ),
    "1",
)
"""What a worker's environment says, so that each has one thread: of its linear algebra, its
kernels, and its software renderer."""
RECORDS = "runs"
"""Folder of the runs' records."""
MAX_DEATHS = 3
"""Processes that a run may take along; then it counts as failed."""
IN_HAND = 2
"""Runs that wait at each worker: it is never idle, and few are lost from sight."""
LOOK_TIME = 1.0
"""In which a worker notices that its driver was killed [s]."""
RUNNING = threading.Lock()
"""Held by a worker while it is at a run."""
ANSWER_TIME = 10.0
"""For an engine to answer [s]."""


class Numbered(Protocol):
    """What can be run."""

    @property
    def number(self) -> int:
        """Of the run."""
        ...


Item = TypeVar("Item", bound=Numbered)
Task = Callable[[Item, Path], dict[str, Any]]
"""(what is run, folder for its pictures) -> its record. What it raises ends all."""
Engine = Callable[[], AbstractContextManager[tuple[Executor, int]]]
"""Makes what runs, and says how many at a time."""


def here(workers: int) -> Engine:
    """So many processes on this machine."""

    @contextmanager
    def engine() -> Iterator[tuple[Executor, int]]:
        # a worker that died is told by its run
        warnings.filterwarnings("ignore", "A worker stopped while some jobs")
        pool = ProcessPoolExecutor(
            max_workers=workers, env=ONE_THREAD, initializer=_begin_worker, initargs=(os.getpid(),)
        )
        try:
            yield pool, workers
        finally:
            pool.shutdown(kill_workers=True)

    return engine


def _give_memory_back() -> None:
    """Hand what a run has freed back to the system: the C library keeps half a gigabyte of a scan's
    arrays, and a pool replaces workers that grow by 300 MB, which costs as much as half a scan.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # of the GNU library alone
    if trim is not None:
        trim(0)


def _begin_worker(driver: int) -> None:
    """Ctrl-C is the driver's, which ends its workers: an interrupted run is no failed one. A worker
    whose driver was killed ends by itself.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_after, args=(driver,), daemon=True).start()


def _end_after(driver: int) -> None:
    """End this process with its driver, after the run that it is at."""
    while os.getppid() == driver:
        time.sleep(LOOK_TIME)
    with RUNNING:
        os._exit(0)


def dask(address: str, folder: Path) -> Engine:
    """The workers of a scheduler of dask.distributed.

    Args:
        address: HOST:PORT of the scheduler.
        folder: Which all workers must see.

    Raises:
        ConfigError: dask.distributed is not installed, nobody answers, or workers do not fit; the
            latter two when the engine is entered.
    """
    try:
        import distributed
    except ImportError as error:
        raise ConfigError(
            "--engine dask:// takes dask.distributed: pip install 'breastscan[cluster]'", address
        ) from error

    @contextmanager
    def engine() -> Iterator[tuple[Executor, int]]:
        try:
            client = distributed.Client(address, timeout=ANSWER_TIME, set_as_default=False)
        except OSError as error:  # TimeoutError is one
            raise ConfigError(
                f"no scheduler answers at {address} ({error}): start one with `dask scheduler`, "
                f"and workers with `dask worker {address} --nthreads 1`",
                address,
            ) from error
        try:
            yield client.get_executor(pure=False), _fitting_workers(client, folder)
        finally:
            with suppress(OSError, CancelledError):
                client.close(ANSWER_TIME)

    return engine


def _fitting_workers(client: Any, folder: Path) -> int:
    """How many workers there are, each with one thread and the folder in sight.

    Raises:
        ConfigError: There is none, or one does not fit.
    """
    workers = client.scheduler_info(n_workers=-1)["workers"]
    if not workers:
        raise ConfigError("the scheduler has no workers: start some with --nthreads 1", None)
    many = [name for name, worker in workers.items() if worker["nthreads"] != 1]
    if many:
        raise ConfigError(
            f"workers need one thread each, since a scan's pictures do: start {', '.join(many)} "
            "with --nthreads 1",
            many,
        )
    blind = [name for name, sees in client.run(os.path.isdir, str(folder.resolve())).items()
             if not sees]  # fmt: skip
    if blind:
        raise ConfigError(
            f"{', '.join(blind)} cannot see {folder.resolve()}: give --out a folder that all "
            "workers share",
            blind,
        )
    return len(workers)


def carry_out(
    task: Task[Item],
    items: Sequence[Item],
    folder: Path,
    engine: Engine,
    told: Callable[[int], None] = lambda done: None,
) -> None:
    """Run all that have no record yet.

    Args:
        task: Of a module, so that workers find it.
        items: What is run.
        folder: Where the records go, and what else the task writes.
        engine: On what.
        told: Called with how many runs have a record by now.

    Raises:
        ConfigError: Another process is at it, the engine is gone, or workers die before they begin.
    """
    records = folder / RECORDS
    records.mkdir(parents=True, exist_ok=True)
    with _alone(folder):
        _forget_deaths(records)
        deaths, left = 0, _left(items, records)
        done = len(items) - len(left)
        told(done)
        while left:
            # begun and not ended: a worker died at it, or at one beside it, as will be seen alone
            suspects = [
                [item] for item in left if _record(records, item).with_suffix(".lock").exists()
            ]
            before = done
            for some in suspects or [left]:
                with engine() as (pool, workers):
                    done = _hand_out(task, some, done, folder, pool, workers, told)
            left = _left(items, records)
            done = len(items) - len(left)
            deaths = deaths + 1 if done == before else 0
            if deaths > MAX_DEATHS:
                raise ConfigError(
                    f"workers died {deaths} times before one finished a run: is there memory "
                    "enough? Fewer --workers take less",
                    deaths,
                )


def _record(records: Path, item: Numbered) -> Path:
    return records / f"{item.number:06}.json"


def _left(items: Sequence[Item], records: Path) -> list[Item]:
    done = {int(path.stem) for path in records.glob("*.json")}
    return [item for item in items if item.number not in done]


def _hand_out(
    task: Task[Item],
    items: Sequence[Item],
    done: int,
    folder: Path,
    pool: Executor,
    workers: int,
    told: Callable[[int], None],
) -> int:
    """Until all have run, or a worker died and took the pool along; how many are done then."""
    coming = iter(items)
    place = str(folder.resolve())
    try:
        waiting = {
            pool.submit(once, task, item, place) for item in islice(coming, workers * IN_HAND)
        }
        while waiting:
            ended, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in ended:
                future.result()
                done += 1
                told(done)
                waiting |= {pool.submit(once, task, item, place) for item in islice(coming, 1)}
    except BrokenExecutor:
        pass  # who is left is seen by the records
    except (CancelledError, OSError) as error:
        if error.args and isinstance(error, OSError) and error.errno is not None:
            raise  # the disk's, for instance
        raise ConfigError(
            f"the engine is gone ({error or type(error).__name__}): what is finished is kept in "
            f"{folder}, and the same command goes on from there",
            error,
        ) from error
    return done


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep other drivers away from a folder."""
    with (folder / f".{RECORDS}.lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ConfigError(
                f"another process fills {folder} right now: wait for it, or give another --out",
                folder,
            ) from error
        yield


def once(task: Task[Item], item: Item, folder: str) -> None:
    """In a worker: run what has no record, whoever else tries to."""
    _one_thread()
    record = _record(Path(folder) / RECORDS, item)
    with RUNNING, _claimed(record.with_suffix(".lock")) as deaths:
        if record.exists():
            return
        if deaths < MAX_DEATHS:
            found = task(item, record.parent)
        else:
            found = {
                "error": f"WorkerDied: its process was killed {deaths} times, or ran out of memory",
                "cause": "WorkerDied",
            }
        part = record.with_suffix(f".{socket.gethostname()}-{os.getpid()}.part")
        part.write_text(json.dumps(found), encoding="utf-8")
        part.replace(record)
    _give_memory_back()


def _forget_deaths(records: Path) -> None:
    """Runs that ended with an earlier driver died of that; those still at theirs keep their
    claim.
    """
    for path in records.glob("*.lock"):
        with suppress(BlockingIOError, FileNotFoundError), path.open() as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink(missing_ok=True)


@contextmanager
def _claimed(path: Path) -> Iterator[int]:
    """Hold a run; yields how many processes died of it. Whoever waits for it gets it after its
    end.
    """
    with path.open("a+") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        lock.seek(0)
        deaths = len(lock.readlines())
        lock.write(f"{socket.gethostname()} {os.getpid()}\n")
        lock.flush()
        try:
            yield deaths
        finally:
            path.unlink(missing_ok=True)


@cache
def _one_thread() -> None:
    """Once in a process, for workers that somebody else started."""
    os.environ |= ONE_THREAD  # read when the renderer starts
    numba.set_num_threads(1)
    cv2.setNumThreads(1)
    threadpool_limits(1)
