"""``python tests/campaign/mutants.py``: break the program on purpose; the campaign must notice.

Each mutant changes one place in a copy of ``src`` and runs the part of the campaign that looks for
such a fault. A table shows the mutants with the first failure; exit code 1 if one was not noticed.
``mutants.py NAME...`` runs some of them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).parent
SOURCE = HERE.parents[1] / "src"
REFEREE = "judge/referee.py"
CLAIMS = "judge/claim_check.py"
FILES = "files/atomic_file.py"
SEED = "3"


@dataclass(frozen=True)
class Mutant:
    """One fault, planted on purpose.

    Parameters
    ----------
    name
        The fault in words.
    file
        Below ``src/skillplan``.
    old, new
        Text that occurs once, and its replacement.
    part
        Part of the campaign that notices.
    kinds
        Kinds of inputs, with commas; empty for all.
    scale
        Of the campaign.
    """

    name: str
    file: str
    old: str
    new: str
    part: str
    kinds: str = ""
    scale: float = 0.01

    def apply(self, package: Path) -> None:
        """Plant the fault in a copy of the package."""
        path = package / self.file
        text = path.read_text("utf-8")
        if text.count(self.old) != 1:
            raise ValueError(f"{self.name}: the text occurs {text.count(self.old)} times")
        path.write_text(text.replace(self.old, self.new), "utf-8")


MUTANTS = [
    Mutant(
        "the referee grants every proof",
        REFEREE,
        "    if cost is not None and bound is not None and bound > cost + tolerance(cost):\n",
        "    return _accept_proof(result, solution)\n"
        "    if cost is not None and bound is not None and bound > cost + tolerance(cost):\n",
        "lies",
    ),
    Mutant(
        "the referee searches no counterexample",
        REFEREE,
        "    if audit and claimed is not None:\n",
        "    if False and claimed is not None:\n",
        "lies",
    ),
    Mutant(
        "the referee passes over violations of a replay",
        REFEREE,
        "    if replayed.violations:\n        fault = replayed.violations[0]\n        where = f",
        "    if False:\n        fault = replayed.violations[0]\n        where = f",
        "lies",
    ),
    Mutant(
        "the referee does not work out expected costs",
        REFEREE,
        "    if least_cost is not None and claimed > least_cost + tolerance(least_cost):\n",
        "    if False and least_cost is not None:\n",
        "lies",
    ),
    Mutant(
        "a back end's answer may be of any type",
        "checks/single_check.py",
        "    if not isinstance(verdict, Verdict):\n",
        "    if False:\n",
        "lies",
    ),
    Mutant(
        "reused verdicts are not asked again",
        "checks/audit.py",
        "                if _contradicts(sample.verdict, fresh):\n",
        "                if False:\n",
        "lies",
    ),
    Mutant(
        "verify accepts a chain of no parts",
        "pipeline/certification.py",
        "    whole = problem.is_chain and origin.part is None\n",
        "    return None\n    whole = problem.is_chain and origin.part is None\n",
        "forgeries",
    ),
    Mutant(
        "verify confirms what it did not check",
        "records/certificate.py",
        "        return Verdict.NOT_CONFIRMED if self.unconfirmed else Verdict.VALID\n",
        "        return Verdict.VALID\n",
        "forgeries",
    ),
    Mutant(
        "verify believes every proof",
        CLAIMS,
        "    holds = bound <= least_cost.cost + tolerance(min(least_cost.cost, bound))\n",
        "    holds = True\n",
        "forgeries",
    ),
    Mutant(
        "verify does not compare the record",
        "pipeline/record_check.py",
        "        amiss = list(list_differences(document, should))\n",
        "        amiss: list[str] = []\n",
        "forgeries",
        scale=0.1,
    ),
    Mutant(
        "verify takes any policy under chance",
        "pipeline/record_check.py",
        "    own = {key: value for key, value in document.items()",
        '    return ""\n    own = {key: value for key, value in document.items()',
        "inputs",
        "policies",
        0.1,
    ),
    Mutant(
        "verify needs no policy under chance",
        "pipeline/record_check.py",
        "            yield Claim(POLICIES, Outcome.NOT_CHECKED, words, ARITHMETIC, open=False)\n",
        "            yield Claim(POLICIES, Outcome.NOT_CHECKED, words, ARITHMETIC)\n",
        "forgeries",
    ),
    Mutant(
        "verify does not read the tables beside",
        "pipeline/record_check.py",
        "            fault = _find_line_fault(text_found.splitlines(), text.splitlines())\n",
        '            fault = ""\n',
        "forgeries",
    ),
    Mutant(
        "report repeats what is refuted",
        "cli/load.py",
        "    if certificate.refuted:\n",
        "    if False:\n",
        "forgeries",
    ),
    Mutant(
        "damaged JSON raises KeyError",
        "files/json_file.py",
        "    return _DECODER.decode(",
        "    try:\n"
        "        json.loads(raw)\n"
        "    except ValueError as error:\n"
        "        raise KeyError(str(error)) from None\n"
        "    return _DECODER.decode(",
        "inputs",
        "json",
        0.1,
    ),
    Mutant(
        "numbers that are too large raise KeyError",
        "files/json_file.py",
        "    if not math.isfinite(value):\n        raise ValueError(",
        "    if not math.isfinite(value):\n        raise KeyError(",
        "inputs",
        "json",
        0.5,
    ),
    Mutant(
        "kept verdicts are believed without their checksum",
        "checks/verdict_files.py",
        'if content["format"] != FORMAT or checksum != hash_content(content):',
        'if content["format"] != FORMAT:',
        "inputs",
        "verdict",
        0.4,
    ),
    Mutant(
        "a robot's description that is damaged raises KeyError",
        "xml_tree.py",
        "    except expat.ExpatError as error:\n",
        "    except ZeroDivisionError as error:\n",
        "inputs",
        "urdf",
        0.1,
    ),
    Mutant(
        "the last file of a result is put in place first",
        FILES,
        "        for name in (*names, last):\n            with _blaming",
        "        for name in (last, *names):\n            with _blaming",
        "writes",
    ),
    Mutant(
        "files are written in place",
        FILES,
        "    temporary = _temporary_name(path)\n    with _piece(temporary) as file:\n"
        "        yield file\n    try:\n        _put_in_place(temporary, path)\n",
        '    with path.open("wb") as file:\n        yield file\n'
        "    temporary = _temporary_name(path)\n    try:\n        pass\n",
        "writes",
    ),
    Mutant(
        "pieces of failed writes stay",
        FILES,
        "            os.fsync(file.fileno())\n    except BaseException:\n"
        "        path.unlink(missing_ok=True)\n        raise\n",
        "            os.fsync(file.fileno())\n    except BaseException:\n        raise\n",
        "writes",
    ),
    Mutant(
        "a new file replaces another one",
        FILES,
        "            os.link(temporary, path)\n",
        "            path.write_bytes(temporary.read_bytes())\n",
        "writes",
    ),
]


def campaign(source: Path, mutant: Mutant) -> tuple[int, str]:
    """Run a part of the campaign on a copy; return the exit code and the first failure."""
    words = ["--seed", SEED, "--scale", str(mutant.scale), "--parts", mutant.part]
    words += ["--kinds", mutant.kinds] if mutant.kinds else []
    done = subprocess.run(
        [sys.executable, str(HERE), *words],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": "1"},
    )
    failures = [line for line in done.stdout.splitlines() if line.startswith(f"{SEED}:")]
    # A campaign that cannot even begin has noticed as well.
    return done.returncode, failures[0] if failures else done.stderr.strip()[-100:]


def run(mutant: Mutant | None, control: Mutant) -> tuple[bool, str]:
    """Run the campaign on a copy with a mutant, or without; whether it failed, and how."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as name:
        source = Path(name) / "src"
        shutil.copytree(SOURCE, source, ignore=shutil.ignore_patterns("__pycache__"))
        if mutant is not None:
            mutant.apply(source / "skillplan")
        code, failure = campaign(source, control)
        return code == 1, failure


def main() -> int:
    """Run all mutants, and each part without one; return 1 if anything is not as it should be."""
    chosen = [item for item in MUTANTS if not sys.argv[1:] or item.name in sys.argv[1:]]
    controls = {(choice.part, choice.kinds, choice.scale): choice for choice in chosen}
    missed = 0
    for control in controls.values():
        failed, failure = run(None, control)
        missed += failed
        words = f"fails without a mutant: {failure}" if failed else "passes without a mutant"
        sys.stdout.write(f"{control.part} {control.kinds}: {words}\n")
    for mutant in chosen:
        noticed, failure = run(mutant, mutant)
        missed += not noticed
        word = "noticed" if noticed else "MISSED"
        sys.stdout.write(f"{mutant.name:<52} {mutant.part:<10} {word:<8} {failure[:90]}\n")
        sys.stdout.flush()
    sys.stdout.write(f"{len(chosen)} mutants, {missed} not as they should be\n")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
