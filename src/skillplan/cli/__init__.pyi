from .app import COMMANDS as COMMANDS
from .app import EPILOG as EPILOG
from .app import app as app
from .app import main as main
from .app import run as run
from .command_group import load_rich_utils as load_rich_utils
from .commands.warm_up import NOTICE as NOTICE
from .commands.warm_up import announce_compilation as announce_compilation
from .interruption import Deadline as Deadline
from .interruption import handle_signals as handle_signals
from .options.values import memory_size as memory_size
from .output import ResultFolder as ResultFolder
from .output import exit_code as exit_code
from .output import write_folder as write_folder
from .waiting import format_progress as format_progress
from .writing import as_json as as_json

__all__ = [
    "COMMANDS",
    "EPILOG",
    "NOTICE",
    "Deadline",
    "ResultFolder",
    "announce_compilation",
    "app",
    "as_json",
    "exit_code",
    "format_progress",
    "handle_signals",
    "load_rich_utils",
    "main",
    "memory_size",
    "run",
    "write_folder",
]
