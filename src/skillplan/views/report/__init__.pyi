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
from .page import json_in_page as json_in_page
from .page import page_html as page_html
from .page import page_style as page_style
from .pictures import picture_svg as picture_svg
from .solver_chapters import comparison_chapter as comparison_chapter
from .summary import lead as lead

__all__ = [
    "Chapter",
    "Markup",
    "Player",
    "Section",
    "comparison_chapter",
    "json_in_page",
    "lead",
    "number",
    "numbers",
    "page_html",
    "page_style",
    "picture_svg",
    "seconds",
    "share",
    "table",
    "tag",
    "text",
]
