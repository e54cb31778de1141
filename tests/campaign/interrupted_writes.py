"""A failing write at every call of a search with ``--out`` and of a checkpoint; kills at random.

What follows is repeated or resumed, and must come to what an uninterrupted run comes to.
"""

from __future__ import annotations

import csv
import gzip
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from failing_io import MODES, VARIABLE, failing, variable
from tally import Tally, call, guarded_folder, holds_to_its_word, progress

HERE = Path(__file__).parent
PROGRAM = [sys.executable, "-m", "skillplan"]
PATIENCE_S = 300
NOT_OVERWRITTEN = ("is not empty", "result", "is there already", "exists")
# What a clock decides; of a kept verdict the checksum is of how long it took, too.
CLOCKS = {"wall_s", "took_s", "learning_s", "checksum"}
SINGLE_FILES = {"report", "export"}
FIXTURES = HERE.parents[1] / "plugins" / "skillplan-cad" / "tests" / "fixtures"
# Seconds that a stage of an import took.
TIMES = re.compile(rb'"[a-z_]*_s": [0-9.e-]+')
# Of a training: what is learned and what can be resumed; the rest tells when and by which command.
LEARNED = ("metrics.jsonl", "policy.json", "policy.safetensors", "last.json", "last.safetensors")


@dataclass(frozen=True)
class Job:
    """A command that keeps something.

    Parameters
    ----------
    name
        Of the kind of case.
    words
        The command line; ``OUT`` stands for the folder.
    again
        What is added where there is a folder already.
    kept
        Returns what counts of the folder.
    last
        File that is written last or alone; if it is there, it is whole, and no command replaces
        it. Empty for jobs that are resumed.
    """

    name: str
    words: Sequence[str]
    again: Sequence[str]
    kept: Callable[[Path], Any]
    last: str = ""

    def prepare(self, folder: Path) -> None:
        """Make the folder for a job that writes a single file."""
        if self.name in SINGLE_FILES:
            folder.mkdir(exist_ok=True)

    def line(self, folder: Path) -> list[str]:
        """Return the command line that begins in, or goes on with, a folder."""
        self.prepare(folder)
        words = [word.replace("OUT", str(folder)) for word in self.words]
        return [*words, *(self.again if folder.exists() else ())]

    def environment(self, folder: Path) -> dict[str, str]:
        """Return an environment whose cache of verdicts is beside, or is, the folder."""
        cache = folder if self.name == "cache-fill" else folder.with_name("cache")
        return {**os.environ, "SKILLPLAN_CACHE_DIR": str(cache)}


def jobs(task: Path) -> dict[str, Job]:
    """Return the commands that are interrupted."""
    physics = ("--physics", "pybullet", "--collision", "contact-pairs")
    learning = ("--solver", "dqn", "--runs", "1", "--steps", "600", "--checkpoint", "100")
    study = ("--solver", "q-learning", "-O", "alpha=0.1,0.5", "-O", "episodes=200", "--runs", "3")
    solved, product = task.with_name("solved"), task.with_name("product.step")
    page = ("report", str(solved), "--no-simulation", "--out", "OUT/page.html")
    code = ("export", str(solved), "--to", "st", "--out", "OUT/plan.st")
    imported = ("import-cad", str(product), "--no-cache", "--out", "OUT")
    results = [
        Job("search", ("search-optimal", str(task), "--out", "OUT"), (), searched, "result.json"),
        Job("report", page, (), files, "page.html"),
        Job("export", code, (), files, "plan.st"),
        Job("import-cad", imported, (), files, "report.json"),
        Job("train", ("train", str(task), *learning, "--out", "OUT"), ("--resume",), learned),
        Job("sweep", ("sweep", str(task), *study, "--out", "OUT"), ("--resume",), swept),
        Job("cache-fill", ("cache", "fill", str(task), *physics), (), verdicts),
    ]
    return {job.name: job for job in results}


def timeless(document: Any) -> Any:
    """Return a document without what a clock decides."""
    if isinstance(document, dict):
        return {key: timeless(item) for key, item in document.items() if key not in CLOCKS}
    return [timeless(entry) for entry in document] if isinstance(document, list) else document


def searched(folder: Path) -> Any:
    """Return the files of a search; nothing else may lie there."""
    assert (folder / "plan.csv").exists(), "there is a result, but no plan beside it"
    names = sorted(path.name for path in folder.iterdir() if not path.name.endswith(".lock"))
    result = timeless(json.loads((folder / "result.json").read_text("utf-8")))
    return names, (folder / "plan.csv").read_bytes(), result


def learned(folder: Path) -> Any:
    """Return what is learned, byte for byte."""
    runs = sorted(folder.glob("runs/*"))
    return {f"{run.name}/{name}": (run / name).read_bytes() for run in runs for name in LEARNED}


def prepare_inputs(task: Path) -> None:
    """Write the result that is reported and exported, and the product that is imported."""
    assert 0 == run_quietly(["search-optimal", str(task), "--out", str(task.with_name("solved"))])
    source = (FIXTURES / "dovetail.step.gz").read_bytes()
    task.with_name("product.step").write_bytes(gzip.decompress(source))


def files(folder: Path) -> dict[str, bytes]:
    """Return all files but those that a killed command has not finished."""
    return {
        str(path.relative_to(folder)): TIMES.sub(b"", path.read_bytes())
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not path.name.endswith((".tmp", ".lock"))
    }


def swept(folder: Path) -> Any:
    """Return the records of a study, in the order of settings and seeds."""
    lines = (folder / "runs.jsonl").read_text("utf-8").splitlines()
    records = [json.dumps(timeless(json.loads(line)), sort_keys=True) for line in lines]
    with (folder / "starts.csv").open(newline="", encoding="utf-8") as file:
        rows = [
            {key: cell for key, cell in row.items() if not key.startswith("learning [s]")}
            for row in csv.DictReader(file)
        ]
    return sorted(records), rows


def verdicts(folder: Path) -> Any:
    """Return all kept verdicts by where they lie; nothing else may lie there."""
    return {
        str(path.relative_to(folder)): timeless(json.loads(path.read_text("utf-8")))
        for path in sorted(folder.rglob("*.json"))
    }


def completed(job: Job, folder: Path, environment: Mapping[str, str] | None = None) -> int:
    """Run a job as a process to its end, and hold it to its word; return the exit code."""
    done = subprocess.run(
        [*PROGRAM, *job.line(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=environment or job.environment(folder),
        timeout=PATIENCE_S,
    )
    holds_to_its_word(done.returncode, done.stderr)
    return done.returncode


def killed(job: Job, folder: Path, after_s: float, *, group: bool) -> None:
    """Start a job and kill it after a time, alone or with all that it started."""
    process = subprocess.Popen(
        [*PROGRAM, *job.line(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=job.environment(folder),
        start_new_session=group,
    )
    try:
        process.wait(after_s)
    except subprocess.TimeoutExpired:
        if group:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.send_signal(signal.SIGKILL)
        process.wait()


def kill_at_random(tally: Tally, task: Path, counts: Mapping[str, int]) -> None:
    """Kill every job so many times, each in a folder of its own, and do it again to its end."""
    for job in jobs(task).values():
        number_of_kills = counts.get(job.name, 0)
        if not number_of_kills:
            continue
        progress(f"kill-{job.name}: {number_of_kills} kills")
        with guarded_folder() as inside:
            begin_s = time.monotonic()
            code = completed(job, inside / "whole")
            lasts_s = time.monotonic() - begin_s
            whole = job.kept(inside / "whole")

            def check(
                chance: random.Random,
                job: Job = job,
                inside: Path = inside,
                lasts_s: float = lasts_s,
                expected: tuple[int, Any] = (code, whole),
            ) -> None:
                shutil.rmtree(inside / "cut", ignore_errors=True)
                for _ in range(chance.choice((1, 1, 2))):
                    after_s = chance.uniform(0.0, 1.05 * lasts_s)
                    killed(job, inside / "cut", after_s, group=chance.random() < 0.5)
                _comes_to_the_same(job, inside / "cut", expected)

            for number in range(number_of_kills):
                tally.case(f"kill-{job.name}", number, check)


def _comes_to_the_same(job: Job, folder: Path, expected: tuple[int, Any]) -> None:
    """Assert that a job, done again, comes to what an uninterrupted one came to."""
    before = whole_result(folder, job)
    done = subprocess.run(
        [*PROGRAM, *job.line(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=job.environment(folder),
        timeout=PATIENCE_S,
    )
    holds_to_its_word(done.returncode, done.stderr)
    if before is not None and done.returncode == 2:
        # What is whole is never overwritten.
        assert any(words in done.stderr for words in NOT_OVERWRITTEN), done.stderr
        assert before == whole_result(folder, job), "a whole result was changed"
    else:
        assert expected[0] == done.returncode, done.stderr
    assert expected[1] == job.kept(folder), "not what an uninterrupted run comes to"


def whole_result(folder: Path, job: Job) -> bytes | None:
    """Return the file that a job writes last, if it is there."""
    path = folder / job.last
    return path.read_bytes() if job.last and path.is_file() else None


def fail_every_call_of_a_search(tally: Tally, task: Path, modes: Sequence[str], step: int) -> None:
    """Let the first call fail, then the next but `step`, until a search meets no failure."""
    job = jobs(task)["search"]
    with guarded_folder() as inside:
        whole_folder, counter = inside / "whole", inside / "calls"
        with failing(whole_folder, counter, 0, "EIO"):
            assert 0 == run_quietly(job.line(whole_folder))
        calls, whole = counter.stat().st_size, job.kept(whole_folder)
        assert calls > 4, "the shim saw no calls"
        progress(f"fail-search: {calls} calls")

        def check(mode: str, number: int) -> None:
            folder = inside / "cut"
            for old in (folder, counter):
                shutil.rmtree(old) if old.is_dir() else old.unlink(missing_ok=True)
            with failing(folder, counter, number, mode):
                code, message = call(*job.line(folder))
            holds_to_its_word(code, message)
            assert code == 0 or "cannot be" in message, message
            if code == 0 and whole_result(folder, job) is not None:
                assert whole == job.kept(folder), "exit code 0, and not all is there"
                return
            before = whole_result(folder, job)
            code, message = call(*job.line(folder))
            if before is None:
                assert code == 0, f"it cannot be repeated: {message}"
            assert whole == job.kept(folder), "the repeated search comes to something else"

        cases = [(mode, number) for mode in modes for number in range(1, calls + 1, step)]
        for index, (mode, number) in enumerate(cases):
            tally.case(
                "fail-search", index, lambda _, mode=mode, number=number: check(mode, number)
            )


def run_quietly(words: Sequence[str]) -> int:
    """Run a command line in this process; return its exit code."""
    code, _ = call(*words)
    return code


def fail_calls_of_a_training(tally: Tally, task: Path, count: int) -> None:
    """Let one call fail in any process of a training, evenly over all calls; then resume it."""
    job = jobs(task)["train"]
    with guarded_folder() as inside:
        site = inside / "site"
        site.mkdir()
        install = "import failing_io\nfailing_io.install_from_environment()\n"
        (site / "sitecustomize.py").write_text(install, "utf-8")
        paths = [str(site), str(HERE), os.environ.get("PYTHONPATH", "")]

        def environment(folder: Path, number: int, mode: str) -> dict[str, str]:
            value = variable(folder, inside / "calls", number, mode)
            more = {"PYTHONPATH": os.pathsep.join(paths), VARIABLE: value}
            return {**job.environment(folder), **more}

        code = completed(job, inside / "whole", environment(inside / "whole", 0, "EIO"))
        calls, whole = (inside / "calls").stat().st_size, job.kept(inside / "whole")
        progress(f"fail-train: {count} of {calls} calls")

        def check(chance: random.Random, number: int) -> None:
            shutil.rmtree(inside / "cut", ignore_errors=True)
            (inside / "calls").unlink(missing_ok=True)
            mode = chance.choice(sorted(MODES))
            completed(job, inside / "cut", environment(inside / "cut", number, mode))
            _comes_to_the_same(job, inside / "cut", (code, whole))

        for index in range(min(count, calls)):
            number = 1 + index * calls // min(count, calls)
            tally.case("fail-train", index, lambda chance, number=number: check(chance, number))
