from .executor import POLL_S as POLL_S
from .executor import Answer as Answer
from .executor import Ended as Ended
from .executor import Executor as Executor
from .executor import ExecutorChoice as ExecutorChoice
from .executor import Prepare as Prepare
from .executor import Worker as Worker
from .executor import pack_content as pack_content
from .local_processes import LocalProcesses as LocalProcesses
from .processes import FedProgram as FedProgram
from .processes import measure_cpu_s_of as measure_cpu_s_of
from .processes import measure_resident_bytes as measure_resident_bytes
from .processes import measure_resident_bytes_of as measure_resident_bytes_of
from .processes import read_output as read_output
from .supervisor import list_descendants as list_descendants

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
    "list_descendants",
    "measure_cpu_s_of",
    "measure_resident_bytes",
    "measure_resident_bytes_of",
    "pack_content",
    "read_output",
]
