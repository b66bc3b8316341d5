"""Open the bag of a run in Rerun: the floor with robots as points, the fleet's figures, the events.

pip install rerun-sdk
python open_in_rerun.py [BAG.mcap]        (default: ../bag/bag.mcap)
python open_in_rerun.py BAG.mcap --save run.rrd
"""

import argparse
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

CENTRE = float("$centre_x"), float("$centre_y")
DISTANCE_M = float("$distance_m")
ROBOT_M = float("$robot_m")  # diameter, filled in by `mrp-sumo export`


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bag", nargs="?", type=Path, default=Path(__file__).resolve().parent.parent / "bag" / "bag.mcap")
    parser.add_argument("--save", type=Path, metavar="FILE", help="write an .rrd file instead of opening the viewer")
    options = parser.parse_args()
    if not options.bag.is_file():
        parser.error(f"{options.bag}: no such file")
    floor = rrb.Spatial3DView(
        name="floor",
        origin="/",
        contents=["/robot_cloud", "/map", "/tf", "/tf_static"],
        overrides={"/robot_cloud": rr.Points3D.from_fields(radii=max(ROBOT_M / 2, DISTANCE_M / 150))},
        background=[245, 245, 245],
        eye_controls=rrb.EyeControls3D(position=(*CENTRE, DISTANCE_M), look_target=(*CENTRE, 0), eye_up=(0, 1, 0)),
    )
    figures = rrb.TextLogView(name="events", origin="/rosout")
    blueprint = rrb.Blueprint(rrb.Vertical(floor, figures, row_shares=[4, 1]), collapse_panels=True)
    rr.init("mrp_sumo", spawn=options.save is None, default_blueprint=blueprint)
    if options.save is not None:
        rr.save(options.save, default_blueprint=blueprint)
    rr.log_file_from_path(options.bag)


if __name__ == "__main__":
    main()
