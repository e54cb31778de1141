"""The names and versions of all documents and files.

Keys may be added to a document, but renaming or removing one takes a new version.
"""

from __future__ import annotations

# The verdict store is on a lower floor, which must not import this one.

# Documents that commands print with --format json and save.
ADVICE = "skillplan.advice/1"
AGREEMENT = "skillplan.agreement/1"
ARM = "skillplan.arm/1"
TOOL = "skillplan.tool/1"
BENCHMARK = "skillplan.benchmark/1"
BENCHMARK_INSTANCES = "skillplan.benchmark-instances/1"
CACHE = "skillplan.cache/1"
CHART = "skillplan.chart/1"
CHECK = "skillplan.check/1"
COMPARISON = "skillplan.comparison/1"
DETECTORS = "skillplan.detectors/1"
ERROR = "skillplan.error/1"
EVALUATION = "skillplan.evaluation/1"
EXPLANATION = "skillplan.explanation/1"
FREEDOM = "skillplan.freedom/1"
FRONT = "skillplan.front/1"
IMPORT = "skillplan.import/1"
NEST = "skillplan.nest/1"
PLAYBACK = "skillplan.playback/1"
PLUGINS = "skillplan.plugins/1"
RELATION = "skillplan.relation/1"
RESULT = "skillplan.result/1"
SIMULATION = "skillplan.simulation/1"
SWEEP = "skillplan.sweep/1"
TRAINING = "skillplan.training/1"
TRAININGS = "skillplan.trainings/1"
VERIFICATION = "skillplan.verification/1"

# Files: policies, and the content of the folder of a training or a study.
CHECKPOINT = "skillplan.checkpoint/1"
NETWORK_POLICY = "skillplan.network-policy/1"
POLICY = "skillplan.policy/1"
RELATIONAL_POLICY = "skillplan.relational-policy/1"
RESOLVED_TASK = "skillplan.resolved-task/1"
RUN = "skillplan.run/1"
RUN_GROUP = "skillplan.group/1"
SWEEP_MANIFEST = "skillplan.sweep-manifest/1"

__all__ = [name for name in dir() if name.isupper()]
