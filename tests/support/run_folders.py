"""Folders of training runs whose policies are known: networks that look a sequence up."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from skillplan import __version__
from skillplan.domains import Problem
from skillplan.env import Observation
from skillplan.files import format_document
from skillplan.model import replay
from skillplan.pipeline import Setup, load_problem, make_model
from skillplan.records import (
    MANIFEST,
    METRICS,
    PROGRESS,
    TASK_CONFIG,
    GroupProgress,
    RunManifest,
    TaskReference,
    fingerprint,
    format_metrics_line,
    get_copy_name,
    get_group_path,
    get_run_path,
    resolve_config,
    write_network,
)
from skillplan.solvers import Episode, NetworkPolicy
from skillplan.task import Task

OPTIMAL = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"
SWITCHED = "0,1,4,5,2,3,8,9,10,11,6,7,13,14,15"
HOPELESS = "0,0"
STEPS = 4_000


def lookup_network(task: Task, kind: str, sequence: str) -> NetworkPolicy:
    """Return a network that takes the actions of a sequence, each where its turn has come.

    A unit of its hidden layer fires for one observation only.
    """
    observation = Observation.of(task, kind)
    state, seen, actions = task.initial, [], []
    for skill in task.parse_sequence(sequence):
        seen.append(observation.encode(state))
        actions.append(task.action(skill))
        state = skill.prediction_in(state).apply(state)
    bits = np.array(seen, dtype=np.float32).T
    first = (2 * bits - 1, 1 - bits.sum(axis=0))
    second = np.zeros((len(actions), len(task.skills)), dtype=np.float32)
    second[np.arange(len(actions)), actions] = 1.0
    biases = np.zeros(len(task.skills), dtype=np.float32)
    return NetworkPolicy((first[0], second), (first[1].astype(np.float32), biases))


@cache
def problem_of(task_file: str, content: bytes) -> Problem:
    """Return what a file sets, read once as long as its content is the same."""
    assert content
    return load_problem(task_file)


def write_runs(
    path: Path,
    task_file: str,
    sequences: Sequence[str | None],
    *,
    observation: str = "markov",
    mask: str = "applicable",
    steps: int = STEPS,
    done: int | None = None,
    copy: bool = False,
    epsilon_end: float | None = None,
) -> Path:
    """Write a folder of runs, each of which has learned to take a sequence.

    Parameters
    ----------
    path
        The folder, which is made.
    task_file
        What is learned.
    sequences
        For every run what it does; None for one without a policy.
    observation, mask
        As of the options.
    steps, done
        Asked, and done; all by default.
    copy
        Whether the user's file is a copy beside the folder, which a test may change.
    epsilon_end
        Share of random actions at the end of the training; None for a learner without them.
    """
    path.mkdir(parents=True)
    if copy:
        task_file = str(shutil.copy(task_file, path.parent / "learned.yaml"))
    problem = problem_of(task_file, Path(task_file).read_bytes())
    task, setup = problem.task, Setup()
    options = {"steps": steps, "observation": observation, "mask": mask, "objective": "reward"}
    if epsilon_end is not None:
        options["epsilon_end"] = epsilon_end
    manifest = RunManifest(
        task=TaskReference(
            name=problem.name,
            kind=problem.kind,
            sha256=problem.sha256,
            source=task_file,
            path=str(Path(task_file).resolve()),
            part=None,
            changes={},
        ),
        solver="look-up",
        options=options,
        steps=steps,
        seed=7,
        seeds=tuple(range(7, 7 + len(sequences))),
        physics=setup.physics_choice(task).name,
        collision=tuple(
            collision_choice.name for collision_choice in setup.collision_choices(task)
        ),
        back_end_options={},
        family=None,
        checkpoint_steps=1_000,
        groups=(tuple(range(len(sequences))),),
        command=("skillplan", "train"),
        versions={"skillplan": __version__},
        git_commit=None,
        machine={},
    )
    (path / MANIFEST).write_text(format_document("skillplan.run/1", manifest))
    (path / get_copy_name(task_file)).write_text(Path(task_file).read_text("utf-8"))
    (path / TASK_CONFIG).write_text(
        format_document("skillplan.resolved-task/1", resolve_config(problem))
    )
    progress = GroupProgress(
        steps=steps if done is None else done,
        failures={},
        wall_s=1.5,
        elapsed_s=1.5,
        checks=0,
        hits=0,
        executions=0,
        asked={},
    )
    get_group_path(path, 0).mkdir(parents=True)
    (get_group_path(path, 0) / PROGRESS).write_text(format_document("skillplan.group/1", progress))
    for run, sequence in enumerate(sequences):
        folder = get_run_path(path, run)
        folder.mkdir(parents=True)
        episodes = some_episodes(task, run, sequence or HOPELESS, progress.steps)
        lines = [f"{format_metrics_line(episode)}\n" for episode in episodes]
        (folder / METRICS).write_text("".join(lines))
        if sequence is None:
            continue
        network = lookup_network(task, observation, sequence)
        seen = [episode.cost for episode in episodes if episode.success]
        content: dict[str, Any] = {
            "features": list(Observation.of(task, observation).features),
            "actions": [skill.name for skill in task.skills],
            "observation": observation,
            "mask": mask,
            "objective": "reward",
            "solver": "look-up",
            "options": options,
            "task": {
                "name": task.name,
                "kind": task.kind,
                "sha256": problem.sha256,
                "fingerprint": fingerprint(task),
            },
            "seed": 7 + run,
            "step": progress.steps,
            "cost": min(seen, default=None),
        }
        write_network(folder, "last", network, **content, kept="last")
        write_network(folder, "policy", network, **content, kept="best" if seen else "last")
    return path


def some_episodes(task: Task, run: int, sequence: str, steps: int) -> list[Episode]:
    """Return episodes of a run that fails at first, and then takes its sequence every time."""
    skills = task.parse_sequence(sequence)
    walked = replay(make_model(task), skills)
    taken = tuple(task.action(skill) for skill in skills)
    episodes, step = [], 0
    while step < steps:
        early = step < (1 + run) * steps // 20
        actions = (0, 0) if early else taken
        step += len(actions)
        if step > steps:
            break
        done = walked.complete and not early
        cost = walked.cost if done else 0.1
        end: Any = "complete" if done else "infeasible"
        episodes.append(Episode(run, step, end, actions, cost, 0.0, greedy=done))
    return episodes


def changed(path: Path, *keys: str | int, to: Any) -> None:
    """Change a value of a JSON document."""
    document = json.loads(path.read_text("utf-8"))
    holder = document
    for key in keys[:-1]:
        holder = holder[key]
    holder[keys[-1]] = to
    path.write_text(json.dumps(document))
