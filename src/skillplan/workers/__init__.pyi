from .executor import POLL_S as POLL_S
from .executor import Answer as Answer
from .executor import Ended as Ended
from .executor import Executor as Executor
from .executor import ExecutorChoice as ExecutorChoice
from .executor import Prepare as Prepare
from .executor import Worker as Worker
from .executor import packed as packed
from .local_processes import LocalProcesses as LocalProcesses
from .processes import FedProgram as FedProgram
from .processes import output_of as output_of
from .processes import resident_bytes as resident_bytes
from .processes import resident_bytes_of as resident_bytes_of
from .supervisor import descendants as descendants

__all__ = [
    "POLL_S",
    "Answer",
    "Ended",
    "Executor",
    "ExecutorChoice",
    "FedProgram",
    "LocalProcesses",
    "Prepare",
    "Worker",
    "descendants",
    "output_of",
    "packed",
    "resident_bytes",
    "resident_bytes_of",
]
