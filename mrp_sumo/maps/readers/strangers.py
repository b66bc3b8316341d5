"""Files that people have and no reader reads: what each is by its first bytes, and what can be done with it."""

import re

KINDS = (  # what the first bytes are like, what the file is, what to do
    (
        rb"AC10\d\d",
        "an AutoCAD drawing (DWG), which CAD programs alone read",
        "save it as DXF there, or with LibreCAD, FreeCAD or the ODA File Converter",
    ),
    (rb"ISO-10303-21", "a building model (IFC or STEP)", "save a floor of it as DXF and import that"),
    (rb"PK\x03\x04", "an archive", "unpack it, and import the map in it; a spreadsheet is saved as CSV"),
    (rb"\x1f\x8b|BZh|\xfd7zXZ|7z\xbc\xaf|Rar!", "an archive", "unpack it, and import the map in it"),
    (
        rb"\x89MCAP|SQLite format 3|#ROSBAG",
        "a bag",
        "play it and save its map with Nav2's map_saver_cli, then import the YAML; runs are read by `mrp-sumo analyze`",
    ),
    (
        rb"(?:<\?xml[^>]*\?>|<!--.*?-->|\s)*<sdf\b",
        "a world of Gazebo, which has no lanes",
        "import the building.yaml that it was made of, or a map that a robot recorded",
    ),
    (
        rb"(?:<\?xml[^>]*\?>|<!--.*?-->|\s)*<osm\b",
        "OpenStreetMap data",
        "make a network of it with SUMO's `netconvert --osm-files`, and import the .net.xml",
    ),
    (
        rb"(?:<\?xml[^>]*\?>|<!--.*?-->|\s)*<(?:robot|mujoco)\b",
        "a description of a robot",
        "types of robots stand in robots/: `mrp-sumo list robots`",
    ),
    (
        rb"(?:<\?xml[^>]*\?>|\s)*<model\b[^>]*XMLSchema-instance",
        "a drawing of openTCS before 4.8",
        "load it in openTCS 4.8 to 4.20 and save the plant model, which is XML",
    ),
    (rb'\s*\{\s*"schema_version": \d+,\s*"step_s"', "a plan of this program", "`mrp-sumo run SCENARIO --plan FILE` drives it"),
    (
        rb'\s*\{.*"(?:typeSpecification|physicalParameters)"\s*:',
        "a factsheet of VDA 5050",
        "`mrp-sumo convert FILE type.yaml` makes a type of robots of it",
    ),
    (rb"(?:<\?xml[^>]*\?>|\s)*<transportOrders\b", "a list of openTCS's transport orders", "import the plant model that it belongs to"),
)
NEEDED = {  # end of a name -> the format that it stands for, what makes a file of it one
    ".lif.json": ("LIF", "'metaInformation' with a 'lifVersion', and 'layouts'"),
    ".site.json": ("RMF site", "'format_version' or 'anchors', and 'levels'"),
    ".building.yaml": ("RMF building", "'levels' with 'vertices' and 'lanes'"),
    ".nav.yaml": ("RMF nav graph", "'levels' with 'vertices' and 'lanes'"),
    ".net.xml": ("SUMO network", "a root <net>"),
    ".geojson": ("route graph", "features with an 'id' (Nav2), or with a 'kind' (this program's)"),
}
_KINDS = tuple((re.compile(mark, re.DOTALL), what, cure) for mark, what, cure in KINDS)


def advice(head: bytes) -> str:
    """The kind of a file and what could be done with it, in half a sentence; '' for what is not known."""
    for mark, what, cure in _KINDS:
        if mark.match(head.removeprefix(b"\xef\xbb\xbf")):
            return f"{what}: {cure}"
    return ""


def lacking(name: str) -> str:
    """Content that a name promises and a file lacks, in half a sentence; "" for names that promise nothing."""
    for suffix, (what, expected) in NEEDED.items():
        if name.lower().endswith(suffix):
            return f"its name says {what}, but it is none: expected {expected}"
    return ""
