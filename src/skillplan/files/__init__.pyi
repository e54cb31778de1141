from .atomic_file import GrowingFile as GrowingFile
from .atomic_file import is_unfinished as is_unfinished
from .atomic_file import replace_file as replace_file
from .atomic_file import write_as_one as write_as_one
from .atomic_file import write_beside as write_beside
from .atomic_file import write_new as write_new
from .atomic_file import write_whole as write_whole
from .folder import FolderLock as FolderLock
from .folder import get_cache_folder as get_cache_folder
from .folder import make_folder as make_folder
from .folder import sync_folder as sync_folder
from .json_file import MAX_DEPTH as MAX_DEPTH
from .json_file import find_json_fault as find_json_fault
from .json_file import format_document as format_document
from .json_file import parse_json as parse_json
from .regular_file import RefusedFile as RefusedFile
from .regular_file import open_regular as open_regular
from .regular_file import read_bytes as read_bytes
from .regular_file import resolve_within as resolve_within
from .yaml import MAX_BYTES as MAX_BYTES
from .yaml import MAX_VALUES as MAX_VALUES
from .yaml import Document as Document
from .yaml import parse as parse

__all__ = [
    "MAX_BYTES",
    "MAX_DEPTH",
    "MAX_VALUES",
    "Document",
    "FolderLock",
    "GrowingFile",
    "RefusedFile",
    "find_json_fault",
    "format_document",
    "get_cache_folder",
    "is_unfinished",
    "make_folder",
    "open_regular",
    "parse",
    "parse_json",
    "read_bytes",
    "replace_file",
    "resolve_within",
    "sync_folder",
    "write_as_one",
    "write_beside",
    "write_new",
    "write_whole",
]
