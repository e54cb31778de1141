from .import_page import draw_import as draw_import
from .import_page import render_import_page as render_import_page
from .markup import Markup as Markup
from .markup import number as number
from .markup import numbers as numbers
from .markup import seconds as seconds
from .markup import share as share
from .markup import table as table
from .markup import tag as tag
from .markup import text as text
from .page import Chapter as Chapter
from .page import Player as Player
from .page import Section as Section
from .page import embed_json as embed_json
from .page import read_page_style as read_page_style
from .page import render_page as render_page
from .pictures import embed_picture as embed_picture
from .solver_chapters import build_comparison_chapter as build_comparison_chapter
from .summary import build_lead as build_lead

__all__ = [
    "Chapter",
    "Markup",
    "Player",
    "Section",
    "build_comparison_chapter",
    "build_lead",
    "draw_import",
    "embed_json",
    "embed_picture",
    "number",
    "numbers",
    "read_page_style",
    "render_import_page",
    "render_page",
    "seconds",
    "share",
    "table",
    "tag",
    "text",
]
