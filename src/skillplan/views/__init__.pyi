from .figures.exploded_figure import assembly_film as assembly_film
from .figures.exploded_figure import exploded_picture as exploded_picture
from .figures.exploded_figure import exploded_png as exploded_png
from .figures.gantt_figure import FAILED as FAILED
from .figures.gantt_figure import NOT_SIMULATED as NOT_SIMULATED
from .figures.gantt_figure import PlanBar as PlanBar
from .figures.gantt_figure import gantt_picture as gantt_picture
from .figures.gantt_figure import plan_bars as plan_bars
from .figures.layout_figure import layout_picture as layout_picture
from .figures.layout_figure import path_steps as path_steps
from .figures.picture import COLOURS as COLOURS
from .figures.picture import NUMBER_PX as NUMBER_PX
from .figures.picture import Note as Note
from .figures.picture import Picture as Picture
from .figures.picture import number_rows as number_rows
from .figures.picture import shortened as shortened
from .figures.precedence_figure import precedence_picture as precedence_picture
from .figures.precedence_graph import Bend as Bend
from .figures.precedence_graph import layers_of as layers_of
from .figures.precedence_graph import precedence_graph as precedence_graph
from .figures.solids import Camera as Camera
from .figures.solids import SolidPainter as SolidPainter
from .figures.solids import hull as hull
from .playback.arm_playback import PLANNED as PLANNED
from .playback.arm_playback import arm_playback as arm_playback
from .playback.arm_playback import contact_entries as contact_entries
from .playback.document import Playback as Playback
from .playback.document import box as box
from .playback.document import upright_along as upright_along
from .playback.meshes import coarser as coarser
from .playback.meshes import hull_mesh as hull_mesh
from .playback.meshes import read_obj as read_obj
from .playback.tracks import FRAMES_PER_S as FRAMES_PER_S
from .playback.tracks import Tracks as Tracks
from .playback.tracks import link_frames as link_frames
from .playback.tracks import rows_of as rows_of
from .report.pictures import picture_svg as picture_svg
from .text.table import Column as Column
from .text.table import ItemList as ItemList
from .text.table import Table as Table
from .text.table import as_csv as as_csv
from .text.table import as_markdown as as_markdown
from .text.table import render as render
from .text.terminal import DEFAULT_WIDTH as DEFAULT_WIDTH
from .text.terminal import LEAST_WIDTH as LEAST_WIDTH
from .text.terminal import output_width as output_width
from .text.terminal import printable as printable
from .text.terminal import table_layout as table_layout
from .text.terminal import wrapped as wrapped
from .text.terminal import wrapped_note as wrapped_note
from .text.wording import escaped as escaped
from .text.wording import evidence_text as evidence_text
from .text.wording import number as number
from .text.wording import percent as percent
from .video_file import save_picture as save_picture
from .video_file import video_file as video_file

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
    "arm_playback",
    "as_csv",
    "as_markdown",
    "assembly_film",
    "box",
    "coarser",
    "contact_entries",
    "escaped",
    "evidence_text",
    "exploded_picture",
    "exploded_png",
    "gantt_picture",
    "hull",
    "hull_mesh",
    "layers_of",
    "layout_picture",
    "link_frames",
    "number",
    "number_rows",
    "output_width",
    "path_steps",
    "percent",
    "picture_svg",
    "plan_bars",
    "precedence_graph",
    "precedence_picture",
    "printable",
    "read_obj",
    "render",
    "rows_of",
    "save_picture",
    "shortened",
    "table_layout",
    "upright_along",
    "video_file",
    "wrapped",
    "wrapped_note",
]
