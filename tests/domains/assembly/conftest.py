"""What tests of assemblies share: a command that says what is in a file."""

import pytest

from skillplan.cli import main


@pytest.fixture
def check(capsys):
    """Run ``check`` in this process: exit code, stdout, stderr."""

    def call(*words):
        with pytest.raises(SystemExit) as ended:
            main(["check", *map(str, words)])
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return call
