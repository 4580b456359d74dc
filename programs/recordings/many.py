"""Evaluation of one question for many recordings: locally, in worker processes, or on dask.

The same function runs in all three cases, by joblib. Each answer is cached at once, with a key of
the recording's content, the question and the estimator's code, so that an interrupted run can be
continued.
"""

import contextlib
import hashlib
import logging
import os
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

import msgspec

from common import compiled
from common.errors import ContactdError, LogError
from programs.recordings.labels import Label
from programs.recordings.question import Answer, Question
from programs.recordings.row_cache import cache_directory, content_digest
from programs.recordings.whatif import ask

_ADDRESS = re.compile(r"[a-z]+://[^/\s]+:\d+", re.ASCII)
_KEPT = 5  # version of the cached answers


class LabelledRecording(msgspec.Struct, frozen=True):
    """Recording with its labels."""

    file: str
    labels: tuple[Label, ...] = ()


def recordings_in(places: Sequence[Path], suffix: str = ".mcap") -> list[Path]:
    """Given recordings, and all files of a `suffix` below given folders. Raises LogError for a
    folder without any."""
    found: list[Path] = []
    for place in places:
        if place.is_dir():
            inside = sorted(path for path in place.rglob(f"*{suffix}") if path.is_file())
            if not inside:
                raise LogError(f"{place}: it contains no recording ({suffix})")
            found += inside
        else:
            found.append(place)
    return list(dict.fromkeys(found))


def answers(
    question: Question,
    asked: Sequence[LabelledRecording],
    workers: int = 1,
    scheduler: str = "",
    progress: Callable[[float], None] = lambda share: None,
) -> Iterator[Answer]:
    """Answers in order of completion; `progress` is called, for local evaluation, with the share of
    a recording that was read.

    `scheduler`: address of a dask scheduler whose workers can access the same files. Raises
    LogError if joblib or dask is not installed or cannot be reached.
    """
    if not scheduler and (workers <= 1 or len(asked) <= 1):
        yield from (kept_answer(question, one, progress=progress) for one in asked)
        return
    try:
        import joblib  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise LogError(
            "--workers and --scheduler need joblib (pip install 'contactd[cluster]')"
        ) from error
    with contextlib.ExitStack() as stack:
        if scheduler:
            stack.enter_context(_on_cluster(scheduler))
        parallel = joblib.Parallel(
            n_jobs=-1 if scheduler else workers, return_as="generator_unordered", batch_size=1
        )
        yield from parallel(joblib.delayed(kept_answer)(question, one) for one in asked)


@contextlib.contextmanager
def _on_cluster(scheduler: str) -> Iterator[None]:
    try:
        from dask.distributed import Client  # noqa: PLC0415 - an extra
        from joblib import parallel_config  # noqa: PLC0415
    except ImportError as error:
        raise LogError(
            "--scheduler needs dask.distributed (pip install 'contactd[cluster]')"
        ) from error
    if not _ADDRESS.fullmatch(scheduler):
        raise LogError(f"--scheduler {scheduler}: must be like tcp://127.0.0.1:8786")
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # its tracebacks add nothing
    try:
        client = Client(scheduler, timeout="3s", set_as_default=False)
    except (OSError, ValueError) as error:
        raise LogError(f"--scheduler {scheduler}: cannot be reached: {error}") from error
    with client, parallel_config(backend="dask", client=client):
        yield


def kept_answer(
    question: Question,
    asked: LabelledRecording,
    cache: Path | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Answer:
    """Answer of one recording, from the cache if it is there."""
    try:
        file = _recording(Path(asked.file))
        digest = content_digest(file)
    except ContactdError as error:
        return Answer(file=asked.file, failed=str(error))
    key = hashlib.blake2b(
        msgspec.json.encode(
            [_KEPT, version("contactd"), compiled.sources(), question, asked.labels]
        ),
        digest_size=16,
    ).hexdigest()
    kept = (cache or cache_directory()) / "answers" / f"{digest}-{key}.json"
    with contextlib.suppress(OSError, msgspec.DecodeError):
        found = msgspec.json.decode(kept.read_bytes(), type=Answer)
        found.file = asked.file
        return found
    answer = ask(file, question, asked.labels, cache, progress)
    answer.file = asked.file
    if not answer.failed:
        _keep(kept, answer)
    return answer


def _recording(file: Path) -> Path:
    """Path of a recording; a black-box log is converted to one."""
    if file.suffix.lower() == ".mcap":
        return file
    from programs.recordings.recomputed import as_recording  # noqa: PLC0415 - slow

    return as_recording(file)


def _keep(path: Path, answer: Answer) -> None:
    """Cache an answer; if that fails, it is computed again next time."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        file, name = tempfile.mkstemp(dir=path.parent, prefix=".partial-")
        with os.fdopen(file, "wb") as stream:
            stream.write(msgspec.json.encode(answer))
        Path(name).replace(path)
