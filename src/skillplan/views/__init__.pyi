from .figures.exploded_figure import draw_exploded_view as draw_exploded_view
from .figures.exploded_figure import film_assembly as film_assembly
from .figures.exploded_figure import render_exploded_png as render_exploded_png
from .figures.gantt_figure import FAILED as FAILED
from .figures.gantt_figure import NOT_SIMULATED as NOT_SIMULATED
from .figures.gantt_figure import PlanBar as PlanBar
from .figures.gantt_figure import draw_gantt_picture as draw_gantt_picture
from .figures.gantt_figure import list_plan_bars as list_plan_bars
from .figures.layout_figure import draw_layout as draw_layout
from .figures.layout_figure import list_path_steps as list_path_steps
from .figures.picture import COLOURS as COLOURS
from .figures.picture import NUMBER_PX as NUMBER_PX
from .figures.picture import Note as Note
from .figures.picture import Picture as Picture
from .figures.picture import place_number_rows as place_number_rows
from .figures.picture import shorten as shorten
from .figures.precedence_figure import draw_precedence as draw_precedence
from .figures.precedence_graph import Bend as Bend
from .figures.precedence_graph import arrange_layers as arrange_layers
from .figures.precedence_graph import build_precedence_graph as build_precedence_graph
from .figures.solids import Camera as Camera
from .figures.solids import SolidPainter as SolidPainter
from .figures.solids import find_hull as find_hull
from .playback.arm_playback import PLANNED as PLANNED
from .playback.arm_playback import build_arm_playback as build_arm_playback
from .playback.arm_playback import list_contacts as list_contacts
from .playback.document import Playback as Playback
from .playback.document import make_box as make_box
from .playback.document import turn_along as turn_along
from .playback.meshes import build_hull_mesh as build_hull_mesh
from .playback.meshes import build_prism_mesh as build_prism_mesh
from .playback.meshes import coarsen as coarsen
from .playback.meshes import read_obj as read_obj
from .playback.tracks import FRAMES_PER_S as FRAMES_PER_S
from .playback.tracks import Tracks as Tracks
from .playback.tracks import compute_link_frames as compute_link_frames
from .playback.tracks import make_rows as make_rows
from .report.pictures import embed_picture as embed_picture
from .text.table import Column as Column
from .text.table import ItemList as ItemList
from .text.table import Table as Table
from .text.table import render as render
from .text.table import render_csv as render_csv
from .text.table import render_markdown as render_markdown
from .text.terminal import DEFAULT_WIDTH as DEFAULT_WIDTH
from .text.terminal import LEAST_WIDTH as LEAST_WIDTH
from .text.terminal import get_output_width as get_output_width
from .text.terminal import lay_out_table as lay_out_table
from .text.terminal import make_printable as make_printable
from .text.terminal import wrap as wrap
from .text.terminal import wrap_note as wrap_note
from .text.wording import escape as escape
from .text.wording import format_evidence as format_evidence
from .text.wording import format_number as format_number
from .text.wording import format_percent as format_percent
from .video_file import open_video as open_video
from .video_file import save_picture as save_picture

__all__ = [
    "COLOURS",
    "DEFAULT_WIDTH",
    "FAILED",
    "FRAMES_PER_S",
    "LEAST_WIDTH",
    "NOT_SIMULATED",
    "NUMBER_PX",
    "PLANNED",
    "Bend",
    "Camera",
    "Column",
    "ItemList",
    "Note",
    "Picture",
    "PlanBar",
    "Playback",
    "SolidPainter",
    "Table",
    "Tracks",
    "arrange_layers",
    "build_arm_playback",
    "build_hull_mesh",
    "build_precedence_graph",
    "build_prism_mesh",
    "coarsen",
    "compute_link_frames",
    "draw_exploded_view",
    "draw_gantt_picture",
    "draw_layout",
    "draw_precedence",
    "embed_picture",
    "escape",
    "film_assembly",
    "find_hull",
    "format_evidence",
    "format_number",
    "format_percent",
    "get_output_width",
    "lay_out_table",
    "list_contacts",
    "list_path_steps",
    "list_plan_bars",
    "make_box",
    "make_printable",
    "make_rows",
    "open_video",
    "place_number_rows",
    "read_obj",
    "render",
    "render_csv",
    "render_exploded_png",
    "render_markdown",
    "save_picture",
    "shorten",
    "turn_along",
    "wrap",
    "wrap_note",
]
