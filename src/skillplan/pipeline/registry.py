"""Plugins by kind and name, found through entry points and imported only when used.

Built-ins register in the same way. A broken plugin is reported when it is used, and by
``skillplan plugins``; it never prevents the use of other plugins.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint
from typing import Any

from pydantic import BaseModel, ValidationError

from skillplan.domains.domain import Domain
from skillplan.errors import Issue, OptionError, PluginError, name_hint
from skillplan.files.schema_errors import list_schema_issues, shown
from skillplan.plugins import installed
from skillplan.plugins.blame import ends_program
from skillplan.records import schemas
from skillplan.workers.supervised import doing, get_import_limit_s


@dataclass(frozen=True)
class PluginInfo:
    """One line of ``skillplan plugins``.

    Parameters
    ----------
    distribution, version
        The distribution that provides the plugin.
    summary
        First line of its docstring; empty if it is broken.
    problem
        Reason why it cannot be used, or None.
    """

    kind: str
    name: str
    distribution: str
    version: str
    summary: str
    problem: str | None = None


def plugin_document(infos: Sequence[PluginInfo], options: type[BaseModel] | None) -> dict[str, Any]:
    """Return the JSON document ``skillplan.plugins/1``."""
    return {
        "schema": schemas.PLUGINS,
        "plugins": [
            {
                "kind": info.kind,
                "name": info.name,
                "distribution": info.distribution,
                "version": info.version,
                "summary": info.summary,
                "problem": info.problem,
            }
            for info in infos
        ],
        "options": None if options is None else options.model_json_schema(),
    }


# Kind to the base class that its plugins must have.
KINDS = {
    "domain": "skillplan.domains.domain:Domain",
    "physics": "skillplan.physics.engine:Engine",
    "collision": "skillplan.collision.detector:Detector",
    "solver": "skillplan.solvers.solver:Solver",
    "executor": "skillplan.workers.executor:Executor",
    "exporter": "skillplan.exporters.exporter:Exporter",
    "sampler": "skillplan.sweep.sampler:Sampler",
}

# Words that users try, to the plugin that they mean.
_MEANT = {
    "solver": {
        "optimal": "exact",
        "astar": "exact",
        "a*": "exact",
        "best": "auto",
        "default": "auto",
        "brute-force": "exhaustive",
        "held-karp": "subset-dp",
        "dynamic-programming": "value-iteration",
    },
    "physics": {"bullet": "pybullet", "none": "kinematic"},
    "collision": {"chart": "precedence", "boxes": "aabb"},
    "executor": {"processes": "local", "multiprocessing": "local", "cluster": "ray"},
    "sampler": {"tpe": "optuna", "bayesian": "optuna"},
    "exporter": {
        "behaviortree": "btcpp",
        "behaviour-tree": "btcpp",
        "groot": "btcpp",
        "plc": "st",
        "iec61131": "st",
        "ros": "ros2",
        "mcap": "ros2",
        "excel": "csv",
    },
}


# Distributions of this project, by the kind and name of the plugins that they provide.
_DISTRIBUTIONS = {
    ("collision", "contact-force"): "skillplan-pybullet",
    ("collision", "contact-pairs"): "skillplan-simulation",
    ("collision", "swept"): "skillplan-pinocchio",
    ("domain", "swarmitfix"): "skillplan-swarmitfix",
    ("executor", "ray"): "skillplan-ray",
    ("exporter", "ros2"): "skillplan-ros2",
    ("figure", "fleet"): "skillplan-swarmitfix",
    ("figure", "placement"): "skillplan-swarmitfix",
    ("figure", "policy"): "skillplan-swarmitfix",
    ("physics", "mujoco"): "skillplan-mujoco",
    ("physics", "pybullet"): "skillplan-pybullet",
    ("sampler", "optuna"): "skillplan-optuna",
    ("solver", "cp-sat"): "skillplan-ortools",
    ("solver", "dqn"): "skillplan-torch",
    ("solver", "fleet"): "skillplan-swarmitfix",
    ("solver", "ppo"): "skillplan-torch",
    ("solver", "relational"): "skillplan-torch",
}


class InstalledDomains(Mapping[str, Domain]):
    """The installed domains by kind, sorted; a domain is imported when it is looked up.

    A look-up raises `PluginError` as `load` does, also for a domain of this project that is not
    installed.
    """

    def __getitem__(self, kind: str) -> Domain:
        if kind not in names("domain") and not missing_words("domain", kind):
            raise KeyError(kind)
        domain: Domain = load("domain", kind)()
        return domain

    def __iter__(self) -> Iterator[str]:
        return iter(names("domain"))

    def __len__(self) -> int:
        return len(names("domain"))


def names(kind: str) -> list[str]:
    """Return the names of the installed plugins of a kind, sorted, without importing them."""
    return sorted(_providers(kind))


def missing_words(kind: str, name: str) -> str:
    """Return the command that installs a plugin of this project; empty for any other plugin."""
    distribution = _DISTRIBUTIONS.get((kind, name))
    if distribution is None:
        return ""
    return (
        f"The {kind} {name!r} is not installed: pip install {distribution}, or in a "
        f"checkout pip install -c constraints.txt -e plugins/{distribution}."
    )


def load(kind: str, name: str) -> type[Any]:
    """Import the class of a plugin.

    Raises
    ------
    PluginError
        If the name is unknown or provided by two distributions, or the class cannot be imported
        or has the wrong base class; the message names plugin and distribution.
    """
    providers = _providers(kind).get(name)
    if not providers:
        meant = _MEANT.get(kind, {}).get(name.casefold(), name)
        words = missing_words(kind, meant)
        if words:
            raise PluginError(words)
        raise PluginError(f"Unknown {kind} {name!r}. {name_hint(meant, names(kind))}")
    if len(providers) > 1:
        owners = " and ".join(_owner(entry) for entry in providers)
        raise PluginError(f"The {kind} {name!r} is provided by {owners}. Uninstall one of them.")
    entry = providers[0]
    limit_s = get_import_limit_s()
    activity = f"the import of the {kind} {name!r} of {_owner(entry)} ({entry.value})"
    try:
        with doing(activity, limit_s=limit_s, forced=True, exit_code=PluginError.exit_code):
            loaded = entry.load()
    except BaseException as error:
        if ends_program(error):
            raise
        reason = f"{type(error).__name__}: {error}"
        raise PluginError(
            f"The {kind} {name!r} of {_owner(entry)} cannot be imported ({entry.value}): {reason}"
        ) from error
    base = _base_class(kind)
    if not (inspect.isclass(loaded) and issubclass(loaded, base)):
        raise PluginError(
            f"The {kind} {name!r} of {_owner(entry)} ({entry.value}) is not a subclass of "
            f"{base.__module__}.{base.__name__}."
        )
    if inspect.isabstract(loaded):
        missing = ", ".join(sorted(getattr(loaded, "__abstractmethods__", ())))
        raise PluginError(f"The {kind} {name!r} of {_owner(entry)} does not implement {missing}.")
    own_name = getattr(loaded, "kind" if kind == "domain" else "name", None)
    if own_name != name:
        raise PluginError(
            f"The {kind} {name!r} of {_owner(entry)} ({entry.value}) calls itself {own_name!r}. "
            "Entry point and class must agree."
        )
    return loaded


def make_options(kind: str, name: str, plugin: type[Any], values: Mapping[str, Any]) -> BaseModel:
    """Return validated options of a plugin.

    Raises
    ------
    OptionError
        If an option is unknown or out of range; the message names the nearest, and the range.
    """
    model: type[BaseModel] = plugin.Options
    unknown = sorted(set(values) - set(model.model_fields))
    if unknown:
        hint = f"It has none at all; name the {kind} whose option it is."
        removed = _removed_hint(plugin, unknown[0])
        if removed:
            hint = removed
        elif model.model_fields:
            hint = name_hint(unknown[0], model.model_fields)
        raise OptionError(f"The {kind} {name!r} has no option {unknown[0]!r}. {hint}")
    try:
        return model.model_validate(dict(values))
    except ValidationError as error:
        lines = [str(issue) for issue in list_schema_issues(error, model)]
        raise OptionError(f"Options of the {kind} {name!r}: {' '.join(lines)}") from None


def choice_issues(kind: str, name: str, values: Mapping[str, Any]) -> list[Issue]:
    """Return the faults of a plugin and options that a task file chooses.

    Paths begin with the plugin's name.
    """
    if name not in names(kind):
        hint = name_hint(name, names(kind))
        return [Issue(f"unknown {kind} back end {shown(name)}. {hint}", (name,), at_key=True)]
    try:
        plugin = load(kind, name)
    except PluginError as error:
        return [Issue(str(error), (name,), at_key=True)]
    model: type[BaseModel] = plugin.Options
    issues = []
    for key in values:
        if key not in model.model_fields:
            hint = _removed_hint(plugin, key) or name_hint(key, model.model_fields)
            message = f"{name!r} has no option {shown(key)}. {hint}"
            issues.append(Issue(message, (name, key), at_key=True))
    try:
        model.model_validate({k: v for k, v in values.items() if k in model.model_fields})
    except ValidationError as error:
        issues += [issue.under(name) for issue in list_schema_issues(error, model)]
    return issues


def _removed_hint(plugin: type[Any], option: str) -> str:
    """Return the key of a task file that replaces a removed option; empty if there is none."""
    removed = getattr(plugin, "removed_options", {}).get(option)
    if removed is None:
        return ""
    return f"Dwell times are part of the task: give {removed.key} of {removed.owners}."


def describe(kind: str) -> list[PluginInfo]:
    """Return all installed plugins of a kind, broken ones with the reason."""
    infos = []
    for name, entries in sorted(_providers(kind).items()):
        for entry in entries:
            summary, problem = "", None
            try:
                plugin = load(kind, name)
                summary = (inspect.getdoc(plugin) or "").partition("\n")[0]
            except PluginError as error:
                problem = str(error)
            distribution, version = _distribution(entry)
            infos.append(PluginInfo(kind, name, distribution, version, summary, problem))
    return infos


def describe_unreadable() -> list[PluginInfo]:
    """Return the distributions whose entry points cannot be read, with the reason."""
    return [
        PluginInfo("unknown", "unknown", name, version, "", problem)
        for name, version, problem in installed.unreadable()
    ]


def refresh() -> None:
    """Look for plugins again, to find those installed since the first look-up."""
    _providers.cache_clear()
    installed.refresh()


@cache
def _providers(kind: str) -> dict[str, list[EntryPoint]]:
    if kind not in KINDS:
        hint = name_hint(kind, KINDS)
        for known in KINDS:
            if kind in _providers(known):
                hint = f"Did you mean '{known} {kind}'?"
        raise PluginError(f"Unknown kind of plugin {kind!r}. {hint}")
    providers: dict[str, list[EntryPoint]] = {}
    for entry in installed.registered(kind):
        others = providers.setdefault(entry.name, [])
        # A distribution may be on the path twice and is still one provider.
        if not others or _owner(entry) not in map(_owner, others):
            others.append(entry)
    return providers


def _base_class(kind: str) -> type[Any]:
    module, _, name = KINDS[kind].partition(":")
    base: type[Any] = getattr(importlib.import_module(module), name)
    return base


def _distribution(entry: EntryPoint) -> tuple[str, str]:
    if entry.dist is None:
        return entry.value, ""
    return installed.name_and_version(entry.dist)


def _owner(entry: EntryPoint) -> str:
    return " ".join(part for part in _distribution(entry) if part)
