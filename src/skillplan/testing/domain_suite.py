"""What every kind of task owes the rest."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any, ClassVar

from skillplan.domains.domain import Domain
from skillplan.files.plain_json import json_fault
from skillplan.pipeline import registry
from skillplan.pipeline.solving import make_model
from skillplan.task.task import Task
from skillplan.testing.tasks import reachable_states


class DomainSuite:
    """What every kind of task owes the rest."""

    domain: ClassVar[str]
    content: ClassVar[dict[str, Any]] = {}

    def tasks(self) -> list[Task]:
        """Return the tasks of `content`."""
        plugin: Domain = registry.load("domain", self.domain)()
        config = plugin.Config.model_validate(self.content)
        assert list(plugin.issues(config)) == []
        return plugin.ground(config, "")

    def test_it_is_registered_under_its_kind(self) -> None:
        """The entry point's name is the kind in the file."""
        assert registry.load("domain", self.domain).kind == self.domain
        assert self.domain in entry_points(group="skillplan.domain").names

    def test_grounding_is_deterministic(self) -> None:
        """The same content gives the same tasks."""
        for one, other in zip(self.tasks(), self.tasks(), strict=True):
            assert one.facts.names == other.facts.names
            assert [s.name for s in one.skills] == [s.name for s in other.skills]
            assert one.initial == other.initial

    def test_exclusive_facts_stay_exclusive(self) -> None:
        """In every reachable state at most one fact of each exclusive group holds."""
        for task in self.tasks():
            groups = [task.facts.of(*group) for group in task.facts.exclusive]
            for state in reachable_states(make_model(task), 500):
                for group in groups:
                    assert len(group & state) <= 1

    def test_costs_and_durations_are_never_negative(self) -> None:
        """Every applicable skill has a cost and a duration of at least 0."""
        for task in self.tasks():
            model = make_model(task)
            for state in reachable_states(model, 500):
                for skill in model.applicable(state):
                    assert skill.cost.at(state) >= 0
                    assert skill.duration_s.at(state) >= 0

    def test_a_chain_that_nobody_has_solved_is_followed_as_it_was_grounded(self) -> None:
        """Without plans, what follows is what stands in for them."""
        plugin: Domain = registry.load("domain", self.domain)()
        config = plugin.Config.model_validate(self.content)
        followed = plugin.follow(config, "", {})
        assert [task.name for task in followed] == [task.name for task in self.tasks()]
        assert [task.initial for task in followed] == [task.initial for task in self.tasks()]

    def test_what_it_says_beyond_the_plans_is_json(self) -> None:
        """Its account can be printed, also of a file that nobody has solved."""
        plugin: Domain = registry.load("domain", self.domain)()
        config = plugin.Config.model_validate(self.content)
        assert json_fault(plugin.account(config, {}).document) is None

    def test_the_schema_describes_every_key(self) -> None:
        """Editors can show what a key of the file means."""
        schema = registry.load("domain", self.domain).Config.model_json_schema()
        assert schema["properties"]
