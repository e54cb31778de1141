"""All that is kept on disk: what is there, and what clearing it leaves."""

from expensive_back_ends import ExpensiveDetector, ExpensiveEngine
from skillplan.checks import DiskVerdictCache, Feasibility, VerdictFolder
from skillplan.model import SkillModel
from skillplan.testing import lid_task, reachable_states

TASK = lid_task()
OTHER = TASK.replace(name="other", chart=())


def filled(folder, task=TASK, plugin=ExpensiveEngine, **options):
    """Keep some verdicts in a folder; return the back end that gave them."""
    queries = plugin(task, plugin.Options(**options))
    feasibility = Feasibility(task, [queries], DiskVerdictCache(folder))
    for state in reachable_states(SkillModel(Feasibility(task)), 20):
        feasibility.verdicts([(k, state) for k in task.skills if k.applicable(state)])
    return queries


def names_in(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_a_survey_finds_every_sound_verdict(tmp_path):
    """Of whatever task and back end; an empty folder, or none, holds none."""
    assert VerdictFolder(tmp_path / "nowhere").survey() == ([], [])
    filled(tmp_path)
    filled(tmp_path, OTHER, ExpensiveDetector)
    sound, others = VerdictFolder(tmp_path).survey()
    assert {(record.record.back_end, record.record.task) for record in sound} == {
        ("expensive-engine", "lid"),
        ("expensive-detector", "other"),
    }
    assert len(sound) == len([name for name in names_in(tmp_path) if name.endswith(".json")])
    assert others == []
    assert all(item.size_bytes == item.path.stat().st_size for item in sound)
    assert all(entry.modified_s == entry.path.stat().st_mtime for entry in sound)


def test_what_a_back_end_would_use_is_what_it_finds(tmp_path):
    """By its key: not what others said, or the same with another option."""
    back_end = filled(tmp_path, seed=1)
    filled(tmp_path, seed=2)
    filled(tmp_path, OTHER, seed=1)
    (own,) = VerdictFolder(tmp_path).kept_for([back_end])
    assert own
    assert {(entry.record.task, entry.record.options["seed"]) for entry in own} == {("lid", 1)}
    fresh = ExpensiveEngine(TASK, back_end.options)
    again = Feasibility(TASK, [fresh], DiskVerdictCache(tmp_path))
    for item in own:
        record = item.record
        again.verdict(TASK.skill(record.skill), TASK.facts.of(*record.state))
    assert again.executions == 0


def litter(folder):
    """Put files into a folder of verdicts that are not the cache's, and some that are."""
    key = next(path for path in (folder / "expensive-engine").iterdir())
    own = [
        folder / "expensive-engine" / f"{'a' * 64}.json",
        key / f".{'b' * 64}.json.123.tmp",
        key / f"{'c' * 64}.json",
    ]
    foreign = [
        folder / "README",
        folder / "expensive-engine" / "notes.txt",
        key / "notes.json",
        folder / "photos" / "holiday.json",
    ]
    for path in (*own, *foreign):
        path.parent.mkdir(exist_ok=True)
        path.write_text("{}")
    return own, foreign


def test_damaged_and_unfinished_files_and_those_of_the_format_before_are_told_apart(tmp_path):
    """From verdicts, and from what is not the cache's."""
    filled(tmp_path)
    own, _ = litter(tmp_path)
    assert sorted(VerdictFolder(tmp_path).survey()[1]) == sorted(own)


def test_clearing_removes_all_that_is_the_caches_own_and_nothing_else(tmp_path):
    """Neither files nor folders, nor what a link leads to."""
    filled(tmp_path / "cache")
    _, foreign = litter(tmp_path / "cache")
    filled(tmp_path / "cache", plugin=ExpensiveDetector)
    filled(tmp_path / "elsewhere")
    (tmp_path / "cache" / "linked").symlink_to(tmp_path / "elsewhere" / "expensive-engine")
    before = names_in(tmp_path / "elsewhere")
    count = len([path for path in (tmp_path / "cache").rglob("*") if path.is_file()])
    assert VerdictFolder(tmp_path / "cache").clear() == count - len(foreign)
    left = [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]
    assert sorted(left) == sorted(foreign)
    assert not (tmp_path / "cache" / "expensive-detector").exists()
    assert names_in(tmp_path / "elsewhere") == before


def test_clearing_a_task_leaves_the_others(tmp_path):
    """By the name it was kept under."""
    filled(tmp_path)
    kept = filled(tmp_path, OTHER)
    count = len(VerdictFolder(tmp_path).survey()[0])
    (own,) = VerdictFolder(tmp_path).kept_for([kept])
    assert VerdictFolder(tmp_path).clear({"lid"}) == count - len(own)
    assert [record.path for record in VerdictFolder(tmp_path).survey()[0]] == sorted(
        item.path for item in own
    )
